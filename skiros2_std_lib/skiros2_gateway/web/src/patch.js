// JSON Merge Patch (RFC 7396).

// Applies a patch in place. Names that an object inherits, such as __proto__, are names like others.
export function applyPatch(target, patch) {
  for (const [key, value] of Object.entries(patch)) {
    if (value === null) delete target[key];
    else if (typeof value === "object" && !Array.isArray(value)) {
      const old = Object.hasOwn(target, key) ? target[key] : null;
      const isObject = typeof old === "object" && old !== null && !Array.isArray(old);
      const own = isObject ? old : {};
      applyPatch(own, value);
      set(target, key, own);
    } else set(target, key, value);
  }
}

// An assignment to __proto__ would change what the object inherits.
function set(target, key, value) {
  Object.defineProperty(target, key, { value, writable: true, enumerable: true, configurable: true });
}

// Has the tables of a document inherit nothing: an entry named `constructor` exists only if the gateway has sent it.
export function withoutPrototypes(document) {
  for (const table of Object.values(document)) Object.setPrototypeOf(table, null);
}
