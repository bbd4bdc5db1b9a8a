/** What the browser remembers in one of its storages; null: nothing, or the page may not store. */
export function recall(storage, key) {
  try {
    return globalThis[storage].getItem(key);
  } catch {
    return null;
  }
}

/** A page that may not store is not remembered. */
export function remember(storage, key, value) {
  try {
    globalThis[storage].setItem(key, value);
  } catch {
    /* nothing to be done */
  }
}
