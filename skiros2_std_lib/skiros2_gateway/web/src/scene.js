// The 3D view: elements where the world model or tf has them, and robots at their joints. Loaded after the page is shown.

import * as three from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { ColladaLoader } from "three/addons/loaders/ColladaLoader.js";
import { OBJLoader } from "three/addons/loaders/OBJLoader.js";
import { STLLoader } from "three/addons/loaders/STLLoader.js";

import { clock, h, setText, visible } from "./dom.js";

const LABEL_HEIGHT = 20; // pixels, at any distance
const TEXT_HEIGHT = 60; // pixels of a label's texture
const FONT = "500 40px system-ui, sans-serif";
const SLOW = 40; // ms for a picture

export class Scene {
  #frames = new Map(); // three.Group by the name of the tf frame
  #elements = new Map(); // {group, marker} by id
  #bodies = new Map(); // a list of meshes by robot
  #files = new Map(); // promises of meshes by URL
  #isWanted = false;
  #timer = null;
  #next = 0; // when a change may be drawn (ms)
  #isCameraChosen = false;
  #bag = ""; // the open bag when the camera was placed

  #shown = null; // the run's scene that is shown, null: the live document

  constructor(panel, cell, run, selection) {
    this.cell = cell;
    this.run = run;
    this.selection = selection;
    this.panel = panel;
    this.renderer = new three.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.moment = h("span", { class: "moment chip paused", hidden: true });
    panel.append(this.renderer.domElement, h("i", { class: "label-style" }), this.moment);
    three.Object3D.DEFAULT_UP.set(0, 0, 1);
    this.scene = new three.Scene();
    this.camera = new three.PerspectiveCamera(45, 1, 0.05, 200);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(-3, -4.5, 4);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.target.set(1, 0, 0.3);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => (this.#isCameraChosen = true));
    const sun = new three.DirectionalLight(0xffffff, 2);
    sun.position.set(-3, -5, 8);
    this.scene.add(new three.HemisphereLight(0xffffff, 0x8a8f98, 1.8), sun);
    this.grid = new three.GridHelper(20, 20);
    this.grid.rotation.x = Math.PI / 2;
    this.scene.add(this.grid);
    this.outline = new three.BoxHelper(this.grid, 0x1f6fb2);
    this.outline.visible = false;
    this.scene.add(this.outline);
    this.renderer.domElement.addEventListener("click", (event) => this.#pick(event));
    new ResizeObserver(() => this.#resize()).observe(panel);
    this.theme();
  }

  // Follows the dark or light theme.
  theme() {
    this.grid.material.color.set(getComputedStyle(this.panel).borderColor);
    this.grid.material.vertexColors = false;
    for (const { label } of this.#elements.values()) {
      label?.material.map?.dispose();
      if (label) label.material.map = null;
    }
    this.draw();
  }

  // Shows another time of the run.
  takeRun() {
    if (this.#shown === this.run.scene) return;
    this.#shown = this.run.scene;
    this.moment.hidden = !this.#shown;
    if (this.#shown) setText(this.moment, `at ${clock(this.run.sceneTime)}`);
    this.take(null);
    if (this.#bag === this.run.bagName) return;
    this.#bag = this.run.bagName;
    this.#isCameraChosen = false;
    this.fit();
  }

  // Takes over a patch of the document; null: the whole document.
  take(patch) {
    if (patch && this.#shown) return; // an earlier time is shown
    const document = this.run.shownScene;
    if (!patch) {
      for (const id of [...this.#elements.keys()]) if (!document.elements[id]) this.#remove(id);
      for (const robot of [...this.#bodies.keys()]) if (!document.bodies[robot]) this.#showBody(robot, []);
    }
    for (const name of Object.keys((patch ?? document).frames ?? {})) this.#placeFrame(name, document.frames[name]);
    for (const id of Object.keys((patch ?? document).elements ?? {})) this.#showElement(id, document.elements[id]);
    for (const robot of Object.keys((patch ?? document).bodies ?? {})) this.#showBody(robot, document.bodies[robot] ?? []);
    this.#drawSoon();
  }

  draw() {
    if (this.#isWanted) return;
    this.#isWanted = true;
    requestAnimationFrame(() => {
      this.#isWanted = false;
      if (!this.panel.clientHeight) return;
      const selected = this.#elements.get(this.selection.id)?.group;
      this.outline.visible = Boolean(selected);
      if (selected) {
        this.scene.updateMatrixWorld();
        this.outline.setFromObject(selected.children[0] ?? selected);
      }
      this.#placeLabels();
      this.renderer.render(this.scene, this.camera);
      const begin = performance.now();
      requestAnimationFrame(() => {
        const took = performance.now() - begin;
        this.#next = begin + (took > SLOW ? 4 * took : 0);
      });
    });
  }

  // Draws a change of the cell. Where drawing is slow, this waits, for the other views follow 25 changes a second.
  #drawSoon() {
    if (this.#timer !== null) return;
    this.#timer = setTimeout(() => {
      this.#timer = null;
      this.draw();
    }, this.#next - performance.now());
  }

  // Hides labels that would cover others; those of small elements stay.
  #placeLabels() {
    this.scene.updateMatrixWorld();
    this.camera.updateMatrixWorld();
    const taken = [];
    const high = (2 * LABEL_HEIGHT) / this.panel.clientHeight; // of the picture, which is 2 high
    const entries = [...this.#elements.values()].filter((entry) => entry.label);
    const extent = ({ group, marker }) => (group.userData.id === this.selection.id ? -1 : Math.max(...marker.size) || 1); // the size of a mesh is not known
    for (const { label, marker } of entries.sort((a, b) => extent(a) - extent(b))) {
      const unit = high * Math.tan((this.camera.fov * Math.PI) / 360);
      label.scale.set(unit * label.userData.aspect, unit, 1);
      const { x, y, z } = new three.Vector3().setFromMatrixPosition(label.matrixWorld).project(this.camera);
      const half = (high * label.userData.aspect) / this.camera.aspect / 2;
      label.visible = z < 1 && !taken.some((other) => Math.abs(x - other.x) < half + other.half && Math.abs(y - other.y) < high);
      if (!label.visible) continue;
      taken.push({ x, y, half });
      if (!label.material.map) paint(label, marker.text);
    }
  }

  // Moves the camera so that all elements are in sight.
  fit() {
    this.scene.updateMatrixWorld();
    const bodies = [...[...this.#elements.values()].map((entry) => entry.body).filter(Boolean), ...[...this.#bodies.values()].flat()];
    const boxes = bodies.map((body) => new three.Box3().setFromObject(body)).filter((box) => !box.isEmpty());
    if (!boxes.length) return;
    const centre = boxes.reduce((all, box) => all.union(box), new three.Box3()).getCenter(new three.Vector3());
    // Each corner of a box is within the picture if the camera is this far from the centre.
    const back = new three.Vector3(-0.55, -0.6, 0.58).normalize();
    const right = new three.Vector3().crossVectors(this.camera.up, back).normalize();
    const up = new three.Vector3().crossVectors(back, right);
    const high = Math.tan((this.camera.fov * Math.PI) / 360);
    let distance = 1;
    for (const { min, max } of boxes) {
      for (let corner = 0; corner < 8; corner++) {
        const at = new three.Vector3(...["x", "y", "z"].map((axis, i) => (corner & (1 << i) ? max : min)[axis])).sub(centre);
        const side = Math.max(Math.abs(at.dot(up)) / high, Math.abs(at.dot(right)) / (high * this.camera.aspect));
        distance = Math.max(distance, 1.06 * (side + at.dot(back)));
      }
    }
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(back, distance);
    this.controls.update();
    this.draw();
  }

  // The group of a frame; it hangs at the root until its parent is known.
  #frame(name) {
    let group = this.#frames.get(name);
    if (!group) {
      group = new three.Group();
      this.#frames.set(name, group);
      this.scene.add(group);
    }
    return group;
  }

  #placeFrame(name, frame) {
    if (!frame) return;
    const [parent, ...pose] = frame;
    place(this.#frame(name), pose);
    this.#attach(this.#frame(name), this.#frame(parent));
  }

  #attach(group, parent) {
    for (let above = parent; above; above = above.parent) if (above === group) return; // frames in a circle
    if (group.parent !== parent) parent.add(group);
  }

  #showElement(id, element) {
    const marker = element?.marker;
    const known = this.#elements.get(id);
    if (!marker) {
      if (known) this.#remove(id);
      return;
    }
    const look = JSON.stringify([marker.shape, marker.size, marker.mesh, marker.colour, marker.text]);
    let entry = known;
    if (known?.look !== look) {
      if (known) this.#remove(id);
      entry = this.#makeElement(id, marker);
      entry.look = look;
      this.#elements.set(id, entry);
    }
    entry.marker = marker;
    // An element that tf moves has its pose there; the frame of any other one is where the element is.
    const own = this.#frame(marker.own);
    if (!this.run.shownScene.frames[marker.own]) {
      place(own, marker.pose);
      this.#attach(own, this.#frame(marker.frame));
    }
    if (entry.group.parent !== own) own.add(entry.group);
  }

  #makeElement(id, marker) {
    const group = new three.Group();
    group.userData.id = id;
    const [red, green, blue, opacity] = marker.colour;
    const colour = new three.Color().setRGB(red, green, blue, three.SRGBColorSpace);
    const material = new three.MeshStandardMaterial({ color: colour, opacity, transparent: opacity < 1, roughness: 0.7 });
    let body = null;
    if (marker.shape === "box") body = new three.Mesh(new three.BoxGeometry(...marker.size), material);
    else if (marker.shape === "mesh") body = this.#load(marker.mesh, material);
    else group.add(new three.AxesHelper(0.12));
    if (body) group.add(body);
    let label = null;
    if (marker.shape !== "axes") {
      label = new three.Sprite(new three.SpriteMaterial({ depthTest: false, transparent: true, sizeAttenuation: false }));
      label.renderOrder = 1; // over transparent elements
      label.center.set(0.5, -0.1);
      label.position.z = marker.size[2] / 2;
      label.userData.aspect = widthOf(marker.text) / TEXT_HEIGHT;
      group.add(label);
    }
    return { group, body, label, marker };
  }

  #remove(id) {
    const { group } = this.#elements.get(id);
    group.removeFromParent();
    dispose(group);
    this.#elements.delete(id);
  }

  #showBody(robot, parts) {
    for (const mesh of this.#bodies.get(robot) ?? []) {
      mesh.removeFromParent();
      dispose(mesh);
    }
    this.#bodies.set(robot, parts.map((part) => {
      const [red, green, blue, opacity] = part.colour ?? [0.7, 0.72, 0.75, 1];
      const colour = new three.Color().setRGB(red, green, blue, three.SRGBColorSpace);
      const material = new three.MeshStandardMaterial({ color: colour, opacity, transparent: opacity < 1, roughness: 0.6, metalness: 0.15 });
      const [x, y, z] = part.size;
      let mesh;
      if (part.shape === "box") mesh = new three.Mesh(new three.BoxGeometry(x, y, z), material);
      else if (part.shape === "sphere") mesh = new three.Mesh(new three.SphereGeometry(x / 2, 24, 16), material);
      else if (part.shape === "cylinder") mesh = new three.Mesh(new three.CylinderGeometry(x / 2, x / 2, z, 24).rotateX(Math.PI / 2), material);
      else mesh = this.#load(part.mesh, material, part.colour === undefined);
      if (part.shape === "mesh") mesh.scale.set(x, y, z);
      const group = new three.Group();
      place(group, part.pose);
      group.add(mesh);
      this.#frame(part.frame).add(group);
      return group;
    }));
  }

  // A group that gets the mesh of a file when it has been read.
  #load(url, material, hasMaterials = false) {
    const group = new three.Group();
    if (!this.#files.has(url)) this.#files.set(url, readMesh(url));
    this.#loads(1);
    this.#files.get(url).then((object) => {
      const copy = object.clone(true);
      copy.traverse((part) => {
        if (part.isMesh && !(hasMaterials && part.material.name)) part.material = material;
      });
      group.add(copy);
      if (!this.#isCameraChosen) this.fit();
      this.draw();
    }, (error) => console.warn(`${url}: ${error.message ?? error}`)).finally(() => this.#loads(-1));
    return group;
  }

  // Counts the meshes that are being read, for programs that wait for the picture.
  #loads(number) {
    this.panel.dataset.loading = Number(this.panel.dataset.loading ?? 0) + number;
  }

  #pick(event) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const at = new three.Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new three.Raycaster();
    ray.setFromCamera(at, this.camera);
    const bodies = [...this.#elements.values()].filter((entry) => entry.body);
    const hits = ray.intersectObjects(bodies.map((entry) => entry.body), true);
    let object = hits[0]?.object ?? null;
    while (object && !object.userData.id) object = object.parent;
    this.selection.select(object?.userData.id ?? null);
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.panel;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    const isFirst = this.camera.aspect === 1;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (isFirst) this.fit();
    this.draw();
  }
}

function place(object, [x, y, z, qx, qy, qz, qw]) {
  object.position.set(x, y, z);
  object.quaternion.set(qx, qy, qz, qw);
}

function dispose(object) {
  object.traverse((part) => {
    for (const material of [part.material ?? []].flat()) {
      material.map?.dispose();
      material.dispose();
    }
  });
}

async function readMesh(url) {
  const manager = new three.LoadingManager();
  const base = url.slice(0, url.lastIndexOf("/") + 1);
  const address = (file) => `/api/live/mesh?url=${encodeURIComponent(file)}`;
  // Textures and materials are named by the mesh: they lie beside it.
  manager.setURLModifier((file) => (file.startsWith("/api/") || file.startsWith("data:") ? file : address(base + file.slice(file.lastIndexOf("/") + 1))));
  const suffix = url.slice(url.lastIndexOf(".") + 1).toLowerCase();
  if (suffix === "stl") {
    const geometry = await new STLLoader(manager).loadAsync(address(url));
    return new three.Mesh(geometry);
  }
  if (suffix === "obj") return new OBJLoader(manager).loadAsync(address(url));
  if (suffix === "dae") {
    const { scene } = await new ColladaLoader(manager).loadAsync(address(url));
    return scene;
  }
  throw new Error("the page shows meshes of the types stl, obj and dae");
}

const measure = document.createElement("canvas").getContext("2d");
measure.font = FONT;
const widthOf = (text) => Math.ceil(measure.measureText(text).width) + 24;

// Draws the text of a label in the colour of the theme.
function paint(sprite, text) {
  const shown = visible(text);
  const canvas = h("canvas", { width: widthOf(shown), height: TEXT_HEIGHT });
  const context = canvas.getContext("2d");
  const style = getComputedStyle(document.querySelector(".label-style"));
  context.font = FONT;
  context.fillStyle = style.backgroundColor;
  context.beginPath();
  context.roundRect(0, 2, canvas.width, 56, 14);
  context.fill();
  context.fillStyle = style.color;
  context.textBaseline = "middle";
  context.fillText(shown, 12, 31);
  sprite.material.map = new three.CanvasTexture(canvas);
  sprite.material.map.colorSpace = three.SRGBColorSpace;
  sprite.material.needsUpdate = true;
}
