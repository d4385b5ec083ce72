// The topics that the page shows, kept up to date by one stream of server-sent events.
//
// The stream is read by `fetch` and not by EventSource: so the page learns that a session has ended,
// and hears the comment lines by which it knows that the daemon is still there.

import { BY_PAGE, me } from "./api.js";
import { useEffect, useState } from "./html.js";
import { Followed } from "./state.js";
import { noteServerTime } from "./time.js";

// Topics that every page needs: the verdict, and what waits for a person.
const ALWAYS = ["overview", "questions", "inbox", "stops"];

// Silence after which a connection counts as lost. The daemon sends a line each 15 s.
const SILENCE = 40000;

// A page that nobody sees gives its connection back after this time: a browser opens six per daemon
// at most, and each page that is open needs one.
const HIDDEN = 10000;

// Waits before a lost connection is tried again: the first, and the longest.
const RETRY_FIRST = 500;
const RETRY_LONGEST = 10000;

// A connection that ends is told to people only after this time, because most return at once.
const TOLD_AFTER = 1500;

// Longest event that is read. A page with 10,000 agents needs a tenth of it.
const EVENT_MAX = 64 << 20;

// Whether the page is up to date: `{ since: null }`, or since when it is not, and why if the daemon says so.
export const link = new Followed({ since: null });

class Topic {
  constructor(name) {
    this.name = name;
    this.rows = new Map();
    this.order = null;
    this.sorted = null;
    this.isLoaded = false;
    this.isRefused = false;
    this.users = 0;
    this.followers = new Set();
    this.kept = null;
  }

  // Takes an event. Rows that have not changed stay the same objects, so that they are not drawn. A
  // large topic comes in several events, of which the first is full.
  take(event) {
    if (event.full) {
      this.rows = new Map();
      this.order = null;
      this.sorted = null;
    }
    for (const key of event.gone ?? []) {
      if (this.rows.delete(key)) this.sorted = null;
    }
    for (const [key, row] of Object.entries(event.rows ?? {})) {
      if (!this.rows.has(key)) this.sorted = null;
      this.rows.set(key, row);
    }
    if (event.order) this.order = event.order;
    this.isLoaded = true;
    this.kept = null;
  }

  // The rows in their order, each with its key: the daemon's order, or that of the keys.
  get list() {
    if (this.kept === null) {
      this.kept = this.keys().filter((key) => this.rows.has(key)).map((key) => ({ key, row: this.rows.get(key) }));
      if (this.name === "conversations") this.kept.sort((one, other) => other.row.last_at - one.row.last_at);
    }
    return this.kept;
  }

  keys() {
    if (this.order !== null) return this.order;
    // Sorting thousands of keys takes longer than a frame, so that is done only for new keys.
    this.sorted ??= [...this.rows.keys()].sort();
    return this.sorted;
  }

  // The only row of a topic that has one; `undefined` if there is none.
  get one() {
    return this.rows.get("");
  }
}

const topics = new Map();
const changed = new Set();
let frame = null;
let stream = null;

function topic(name) {
  if (!topics.has(name)) topics.set(name, new Topic(name));
  return topics.get(name);
}

// Returns a topic, and draws the component again, at most once per frame, when it changes.
export function useTopic(name) {
  const [, again] = useState(0);
  useEffect(() => {
    const followed = topic(name);
    const follower = () => again((n) => n + 1);
    followed.users += 1;
    followed.followers.add(follower);
    if (followed.isLoaded) follower();
    want();
    return () => {
      followed.users -= 1;
      followed.followers.delete(follower);
      want();
    };
  }, [name]);
  return topic(name);
}

// Calls `follower` with each event of a topic, before it is drawn.
const watchers = new Map();
export function watchTopic(name, follower) {
  watchers.set(name, follower);
}

function wanted() {
  const shown = [...topics.values()].filter((one) => one.users > 0 && !one.isRefused).map((one) => one.name);
  // The screen of a robot sees this robot only.
  if (me.value?.screen) return shown.filter((name) => name === `robot:${me.value.screen}`);
  return [...new Set([...ALWAYS, ...shown])].sort();
}

let isWanting = false;

// Connects with the topics that are shown now. Several changes in one turn connect once.
function want() {
  if (isWanting) return;
  isWanting = true;
  setTimeout(() => {
    isWanting = false;
    const names = wanted();
    // What nobody shows any more is forgotten: it would be old when it is shown again.
    for (const one of topics.values()) if (one.users === 0 && !ALWAYS.includes(one.name)) topics.delete(one.name);
    const isSame = stream !== null && names.join() === stream.names.join();
    if (!isSame) connect();
  }, 0);
}

// Ends the present stream, and begins one if a person is signed in and sees the page.
function connect() {
  stream?.abort.abort();
  stream = null;
  if (!me.value || isPaused) return;
  const names = wanted();
  if (names.length === 0) return;
  stream = { names, abort: new AbortController(), retry: RETRY_FIRST, isAgain: false, problem: null };
  follow(stream);
}

async function follow(mine) {
  while (stream === mine) {
    const ended = await read(mine);
    if (stream !== mine) return;
    if (ended === 401) {
      me.set(null);
      return;
    }
    if (ended === 400 && refuse(mine.names)) return connect();
    // The session of a person at a screen has ended, or a right is gone.
    if (ended === 403) await checkVersion();
    if (stream !== mine) return;
    lost(mine.problem);
    mine.isAgain = true;
    await pause(mine.retry * (0.5 + Math.random()), mine.abort.signal);
    mine.retry = Math.min(mine.retry * 2, RETRY_LONGEST);
  }
}

// An address may name a thing that cannot be: the daemon refuses its topic. Then there is nothing of
// that name, and the other topics are asked for alone. Returns whether there was such a topic.
function refuse(names) {
  const things = [...topics.values()].filter((one) => one.name.includes(":") && names.includes(one.name));
  for (const one of things) {
    one.isRefused = true;
    one.isLoaded = true;
    for (const follower of [...one.followers]) follower();
  }
  return things.length > 0;
}

function pause(milliseconds, signal) {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, milliseconds);
    signal.addEventListener("abort", () => { clearTimeout(timer); resolve(); }, { once: true });
  });
}

// Reads one connection to its end. Returns the status that ended it, or 0.
async function read(mine) {
  const names = mine.names.map(encodeURIComponent).join(",");
  const attempt = new AbortController();
  const end = () => attempt.abort();
  mine.abort.signal.addEventListener("abort", end, { once: true });
  let watch = setTimeout(end, SILENCE);
  try {
    const answer = await fetch(`/api/events?topics=${names}`, {
      headers: { Accept: "text/event-stream", ...(mine.isAgain ? BY_PAGE : {}) }, credentials: "same-origin", cache: "no-store",
      redirect: "error", signal: attempt.signal,
    });
    mine.problem = answer.ok ? null : (await answer.json().catch(() => null))?.problem ?? null;
    if (!answer.ok) return answer.status;
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    const parser = new EventParser();
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return 0;
      clearTimeout(watch);
      watch = setTimeout(end, SILENCE);
      const events = parser.push(value);
      if (stream !== mine) return 0;
      found(mine);
      events.forEach(take);
    }
  } catch {
    return 0;
  } finally {
    clearTimeout(watch);
    attempt.abort();
    mine.abort.signal.removeEventListener("abort", end);
  }
}

// Splits a stream into events (HTML standard, “server-sent events”).
export class EventParser {
  constructor() {
    this.rest = "";
    this.clear();
  }

  clear() {
    this.name = "";
    this.data = [];
  }

  push(text) {
    const lines = (this.rest + text).split(/\r\n|\n|\r(?!$)/);
    this.rest = lines.pop();
    if (this.rest.length > EVENT_MAX) throw new Error("an event is too long");
    const events = [];
    for (const line of lines) {
      if (line === "") {
        if (this.data.length > 0) events.push({ topic: this.name, data: this.data.join("\n") });
        this.clear();
        continue;
      }
      const colon = line.indexOf(":");
      const field = colon < 0 ? line : line.slice(0, colon);
      const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
      if (field === "event") this.name = value;
      else if (field === "data") this.data.push(value);
    }
    return events;
  }
}

function take({ topic: name, data }) {
  let event;
  try {
    event = JSON.parse(data);
  } catch {
    return;
  }
  noteServerTime(event.now);
  watchers.get(name)?.(event);
  // What every page needs may come before the first component that shows it, and comes once only.
  const followed = ALWAYS.includes(name) ? topic(name) : topics.get(name);
  if (!followed) return;
  followed.take(event);
  changed.add(followed);
  frame ??= requestAnimationFrame(draw);
}

function draw() {
  frame = null;
  const all = [...changed];
  changed.clear();
  for (const one of all) for (const follower of [...one.followers]) follower();
}

let lostAt = null;
let telling = null;

function lost(problem) {
  lostAt ??= Date.now();
  if (link.value.since !== null && link.value.problem !== problem) link.set({ since: lostAt, problem });
  telling ??= setTimeout(() => link.set({ since: lostAt, problem }), TOLD_AFTER);
}

function found(mine) {
  mine.retry = RETRY_FIRST;
  if (lostAt === null) return;
  clearTimeout(telling);
  telling = null;
  lostAt = null;
  if (link.value.since !== null) link.set({ since: null });
  checkVersion();
}

// The daemon may have been renewed while the page was open: a page of an older version is loaded
// again, at its own address.
export async function checkVersion() {
  const before = me.value?.version;
  try {
    const answer = await fetch("/api/me", { headers: BY_PAGE, credentials: "same-origin", cache: "no-store" });
    if (answer.status === 401) return me.set(null);
    // Another refusal, perhaps of a proxy, says nothing about the person.
    if (!answer.ok) return;
    const found = await answer.json();
    if (before && found.version && found.version !== before) return location.reload();
    me.set(found);
  } catch {
    // The stream tells when the daemon is gone again.
  }
}

let isPaused = false;
let hiding = null;

document.addEventListener("visibilitychange", () => {
  clearTimeout(hiding);
  if (document.hidden) {
    hiding = setTimeout(() => { isPaused = true; connect(); }, HIDDEN);
  } else if (isPaused) {
    isPaused = false;
    connect();
    if (me.value) checkVersion();
  }
});

// A page that is left may be kept by the browser for its button "back", with its connection.
addEventListener("pagehide", () => { isPaused = true; connect(); });
addEventListener("pageshow", (event) => {
  if (!event.persisted) return;
  isPaused = false;
  connect();
});

let screenOf = null;

me.follow((person) => {
  const isOther = (person?.screen ?? null) !== screenOf;
  screenOf = person?.screen ?? null;
  if (person === null || isOther) {
    for (const one of topics.values()) {
      one.rows = new Map();
      one.order = null;
      one.sorted = null;
      one.kept = null;
      one.isLoaded = false;
    }
    clearTimeout(telling);
    telling = null;
    lostAt = null;
    link.set({ since: null });
    connect();
  } else if (stream === null) connect();
});
