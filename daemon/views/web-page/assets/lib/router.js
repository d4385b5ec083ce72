// Addresses: each page has one, and every link is one. The browser's back and forward work.

import { Followed } from "./state.js";

// The present address: `{ path, parts, query }`.
export const place = new Followed(read());

function read() {
  const parts = location.pathname.split("/").filter((part) => part !== "").map(decode);
  return { path: location.pathname, parts, query: new URLSearchParams(location.search) };
}

// A broken escape in an address is text, not an error.
function decode(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

// Goes to an address of the page.
export function go(address) {
  if (address === location.pathname + location.search) return;
  history.pushState(null, "", address);
  place.set(read());
  scrollTo(0, 0);
}

// Keeps a part of the query, such as a filter, in the address without a new step back.
export function keep(name, value) {
  const query = new URLSearchParams(location.search);
  if (value) query.set(name, value);
  else query.delete(name);
  const text = query.toString();
  history.replaceState(null, "", location.pathname + (text ? `?${text}` : ""));
}

// Returns the address of a thing.
export function to(page, name) {
  return name === undefined ? `/${page}` : `/${page}/${encodeURIComponent(name)}`;
}

// Returns the address of what a sentence is about; `null` if it has none.
export function toSubject(subject) {
  switch (subject?.of) {
    case "goal": return to("goals", subject.name);
    case "agent": return to("agents", subject.name);
    case "daemon": return to("daemons");
    case "questions": return to("questions");
    case "conversation": return to("conversations", subject.name);
    default: return null;
  }
}

addEventListener("popstate", () => place.set(read()));

document.addEventListener("click", (event) => {
  const link = event.target.closest?.("a[href]");
  const isPlain = event.button === 0 && !event.metaKey && !event.ctrlKey && !event.shiftKey && !event.altKey;
  if (!link || !isPlain || link.target || link.hasAttribute("download") || event.defaultPrevented) return;
  const url = new URL(link.href);
  if (url.origin !== location.origin || url.pathname.startsWith("/api/") || url.hash !== "") return;
  event.preventDefault();
  go(url.pathname + url.search);
});
