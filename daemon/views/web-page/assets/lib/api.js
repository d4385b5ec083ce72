// Requests to the daemon, and the session of the person.

import { t } from "./language.js";
import { Followed } from "./state.js";

// Time limit of a request. A stop must be asked again soon if it was lost; a plan may take longer.
const ANSWERING = 15000;
const PLANNING = 60000;

// Who is signed in: `undefined` until that is known, `null` if nobody is, or the answer of /api/me.
export const me = new Followed(undefined);

// Why this browser could not be made the screen of a robot: a sentence, or empty.
export const screenProblem = new Followed("");

// What the daemon says of its ecosystem: predicates, objects, actions; `null` until it is loaded.
export const setup = new Followed(null);

// A request that failed, with a sentence for people.
export class Problem extends Error {
  constructor(sentence, status) {
    super(sentence);
    this.status = status;
  }
}

// Header of what the page asks for by itself: that does not prolong the session of a person.
export const BY_PAGE = { "X-Althing-By-Page": "1" };

// Returns the answer to a GET. `headers` is BY_PAGE for what no person has asked for.
export async function get(path, headers = {}) {
  return request(path, { method: "GET", headers }, ANSWERING);
}

// Returns the answer to a POST with a JSON body.
export async function post(path, body, deadline = ANSWERING) {
  const headers = { "Content-Type": "application/json" };
  if (me.value?.csrf) headers["X-Althing-CSRF"] = me.value.csrf;
  return request(path, { method: "POST", headers, body: JSON.stringify(body) }, deadline);
}

async function request(path, options, deadline) {
  let answer;
  try {
    answer = await fetch(path, {
      ...options, credentials: "same-origin", cache: "no-store", redirect: "error",
      signal: AbortSignal.timeout(deadline),
    });
  } catch {
    throw new Problem(t("problem.unreached"), 0);
  }
  const text = await answer.text().catch(() => "");
  let said = null;
  try {
    said = text === "" ? null : JSON.parse(text);
  } catch {
    // A proxy between the browser and the daemon may answer with a page of its own.
  }
  if (answer.ok) return said;
  if (answer.status === 401 && path !== "/api/sign-in" && path !== "/api/screen") me.set(null);
  // At a screen, the session of a person may have ended: then the screen asks for itself.
  if (answer.status === 403 && me.value && path !== "/api/me") refreshMe().catch(() => {});
  throw new Problem(said?.problem ?? t("problem.status", { status: answer.status }), answer.status);
}

// Asks who is signed in.
export async function refreshMe() {
  try {
    const found = await get("/api/me");
    const isNew = me.value?.person !== found.person || me.value?.csrf !== found.csrf;
    // What has not changed is not drawn again.
    if (isNew || JSON.stringify(me.value) !== JSON.stringify(found)) me.set(found);
    if (isNew && !found.screen) loadSetup();
  } catch (problem) {
    if (problem.status === 401) me.set(null);
    else throw problem;
  }
}

// Signs a person in.
export async function signIn(name, password) {
  await post("/api/sign-in", { name, password });
  await refreshMe();
}

// Signs the person out. The screen of a robot is then that again. Throws if the daemon is not reached:
// the session is then still there, and who reads the page must know.
export async function signOut() {
  try {
    await post("/api/sign-out", {});
  } catch (problem) {
    if (problem.status !== 401) throw problem;
  }
  me.set(null);
  await refreshMe();
}

// The beginning of the part of an address that makes a browser the screen of a robot. Browsers send
// this part to nobody.
const SCREEN = "#screen=";
let screenToken = null;

// Makes this browser a screen, if its address says so; the token is then in a cookie that no script
// reads, and in the address no more. Throws if the daemon is not reached.
export async function becomeScreen() {
  if (location.hash.startsWith(SCREEN)) {
    screenToken = location.hash.slice(SCREEN.length);
    history.replaceState(null, "", location.pathname + location.search);
  }
  if (screenToken === null) return;
  try {
    await post("/api/screen", { token: screenToken });
  } catch (problem) {
    if (problem.status === 0) throw problem;
    screenProblem.set(problem.message);
  }
  screenToken = null;
}

// Loads what the daemon says of its ecosystem. The goal builder says so if it is missing.
export async function loadSetup() {
  try {
    setup.set(await get("/api/setup", BY_PAGE));
  } catch {
    // The builder asks again when it is opened.
  }
}

// Returns goals and facts, given in PDDL, in the words of a language.
export async function said(pddl, tag) {
  const of = pddl.map((one) => `&of=${encodeURIComponent(one)}`).join("");
  return (await get(`/api/words?language=${encodeURIComponent(tag)}${of}`, BY_PAGE)).said;
}

// Asks the daemon to do something for the person, and returns `{ok, sentence, conversation, detail}`.
// What the daemon refuses is an outcome, too.
export async function act(wanted) {
  const deadline = wanted.act === "dry-run" ? PLANNING : ANSWERING;
  try {
    const outcome = await post("/api/acts", wanted, deadline);
    return { conversation: null, detail: null, ...outcome };
  } catch (problem) {
    return { ok: false, sentence: problem.message, conversation: null, detail: null, status: problem.status };
  }
}

// Whether the questions of an agent may be answered here: by a person with the right, or at the screen
// of this agent.
export function mayAnswer(agent) {
  return may("ask") || (me.value?.screen ?? null) === agent;
}

// Whether the person has a right. The daemon decides; the page only does not offer what is refused.
export function may(right) {
  return me.value?.rights?.includes(right) ?? false;
}
