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

  /** Takes values, and tells it. */
  set(event, values) {
    Object.assign(this, values);
    this.emit(event);
  }

  /** Takes something into a set, or out of it, and tells it. */
  toggle(event, set, one) {
    if (!set.delete(one)) set.add(one);
    this.emit(event);
  }

  emit(event) {
    for (const listener of this.#listeners.get(event) ?? []) listener();
  }
}
