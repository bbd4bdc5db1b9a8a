/** Tells listeners of events by name. */
export class Emitter {
  #listeners = new Map();

  on(events, listener) {
    for (const event of events.split(' ')) {
      if (!this.#listeners.has(event)) this.#listeners.set(event, []);
      this.#listeners.get(event).push(listener);
    }
  }

  /** Calls a listener now, and at each event. */
  follow(events, listener) {
    this.on(events, listener);
    listener();
  }

  emit(event) {
    for (const listener of this.#listeners.get(event) ?? []) listener();
  }
}
