// Browsers start no worker from a file: a hidden frame does its work there, so that the search of a page opened
// from a folder answers. Pages that come from a server keep the real one.
"use strict";

if (location.protocol === "file:") {
  const load = (scope, address) => new Promise((done, failed) => {
    const script = scope.document.createElement("script");
    Object.assign(script, { src: address, onload: done, onerror: failed });
    scope.document.head.append(script);
  });

  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.scope = frame.contentWindow;
      this.scope.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.scope.importScripts = (...scripts) =>
        scripts.reduce((before, script) => before.then(() => load(this.scope, script)), Promise.resolve());
      this.loaded = load(this.scope, address);
    }

    postMessage(data) {
      this.loaded.then(() => this.scope.dispatchEvent(new MessageEvent("message", { data })));
    }
  };
}
