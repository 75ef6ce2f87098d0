// Calls of the worker, each answered by a promise.

import { element } from "./status.js";

export class Background {
  constructor() {
    const source = new Blob([element("worker").textContent], { type: "text/javascript" });
    this.worker = new Worker(URL.createObjectURL(source));
    this.waiting = new Map();
    this.count = 0;
    this.worker.onmessage = ({ data: { id, result, error } }) => {
      const { done, failed } = this.waiting.get(id);
      this.waiting.delete(id);
      if (error) failed(new Error(error));
      else done(result);
    };
  }

  call(action, request, transferred = []) {
    const id = this.count++;
    return new Promise((done, failed) => {
      this.waiting.set(id, { done, failed });
      this.worker.postMessage({ id, action, request }, transferred);
    });
  }
}
