// Browsers start no worker of a page that was opened as a file: the site's search would never begin. On such pages this
// replaces Worker by a hidden frame, which runs the script in the page's own thread. The theme asks for the class's name.
class IFrameWorker extends EventTarget {
  constructor(url) {
    super();
    this.url = new URL(url, document.baseURI).href;
    this.frame = document.createElement("iframe");
    this.frame.hidden = true;
    document.body.append(this.frame);
    const inner = this.frame.contentWindow;
    inner.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
    inner.importScripts = async (...names) => {
      for (const name of names) await this.load(name);
    };
    this.ready = this.load(this.url);
  }

  load(url) {
    return new Promise((resolve, reject) => {
      const script = this.frame.contentDocument.createElement("script");
      script.src = new URL(url, this.url).href;
      script.onload = resolve;
      script.onerror = () => reject(new Error(`${script.src} cannot be loaded`));
      this.frame.contentDocument.body.append(script);
    });
  }

  postMessage(data) {
    this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data })));
  }

  terminate() {
    this.frame.remove();
  }
}

if (location.protocol === "file:") {
  window.IFrameWorker = IFrameWorker;
  window.Worker = IFrameWorker;
}
