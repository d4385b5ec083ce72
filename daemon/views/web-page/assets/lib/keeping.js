// What this browser keeps of its own: a choice of language and colors, where rooms stand, a picture.

const PREFIX = "althing.";

// Returns what was kept; `null` if there is nothing, or it cannot be read.
export function recall(name) {
  try {
    return JSON.parse(localStorage.getItem(PREFIX + name));
  } catch {
    return null;
  }
}

// Keeps a value. Returns whether the browser could: it may be full, or forbid it.
export function remember(name, value) {
  try {
    localStorage.setItem(PREFIX + name, JSON.stringify(value));
    return true;
  } catch {
    return false;
  }
}

// Forgets a value.
export function forget(name) {
  try {
    localStorage.removeItem(PREFIX + name);
  } catch {
    // There is nothing to forget in a browser that keeps nothing.
  }
}
