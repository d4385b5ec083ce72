// A value that parts of the page follow: they are drawn again when it changes.

import { useEffect, useState } from "./html.js";

export class Followed {
  constructor(value) {
    this.value = value;
    this.followers = new Set();
  }

  set(value) {
    if (Object.is(value, this.value)) return;
    this.value = value;
    for (const follower of [...this.followers]) follower(value);
  }

  follow(follower) {
    this.followers.add(follower);
    return () => this.followers.delete(follower);
  }
}

// Returns the value, and draws the component again when it changes.
export function useFollowed(followed) {
  const [, again] = useState(0);
  const drawn = followed.value;
  useEffect(() => {
    // It may have changed between the drawing and this effect.
    const end = followed.follow(() => again((n) => n + 1));
    if (!Object.is(drawn, followed.value)) again((n) => n + 1);
    return end;
  }, [followed]);
  return drawn;
}
