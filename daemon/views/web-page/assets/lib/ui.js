// Small parts that several pages draw with.

import { act, me, signOut } from "./api.js";
import { Component, html, useEffect, useId, useLayoutEffect, useRef, useState } from "./html.js";
import { t, tOr } from "./language.js";
import { go, to } from "./router.js";
import { told } from "./told.js";
import { line, lines } from "./visible.js";

// A text from outside, on one line. `bdi` keeps a name of another direction from reordering others.
export function Text({ of }) {
  return html`<bdi>${line(of)}</bdi>`;
}

// A sentence of the ecosystem, in the language of the page if it is a fixed one.
export function Told({ of }) {
  return html`<bdi>${told(of)}</bdi>`;
}

// A text from outside, of several lines, such as a model.
export function Code({ of, label }) {
  return html`<pre class="code" tabindex="0" role="group" aria-label=${label}><code>${lines(of)}</code></pre>`;
}

// A button that signs the person out, and says so if that did not work.
export function SignOut({ label }) {
  const [problem, setProblem] = useState("");
  const leave = () => { setProblem(""); signOut().catch((why) => setProblem(why.message)); };
  return html`<button type="button" class="button" onClick=${leave}>${label}</button>
    <span role="alert">${problem && html`<span class="problem"><${Sign} of="bad" /> <${Text} of=${problem} /></span>`}</span>`;
}

// A sign that says in a shape what a word beside it says, too.
export function Sign({ of }) {
  const signs = { well: "✓", attention: "!", bad: "✗", info: "·" };
  return html`<span class="sign sign-${of}" aria-hidden="true">${signs[of] ?? "·"}</span>`;
}

// A state as a word with a sign: never by color alone.
const STATES = {
  unknown: ["quiet", "?"], waiting: ["attention", "‖"], scheduled: ["quiet", "◷"], planning: ["accent", "…"], running: ["accent", "▶"],
  holding: ["well", "✓"], done: ["well", "✓"], failed: ["bad", "✗"], cancelled: ["quiet", "–"], next: ["quiet", "·"],
  refused: ["bad", "✗"], present: ["well", "●"], silent: ["attention", "!"], gone: ["bad", "✗"],
  absent: ["attention", "○"], busy: ["accent", "▶"], stopped: ["bad", "■"], true: ["well", "✓"], false: ["quiet", "–"],
  lasting: ["quiet", "·"], fresh: ["quiet", "·"], ending: ["attention", "!"], stale: ["attention", "!"],
  disputed: ["bad", "≠"], offered: ["quiet", "·"], won: ["accent", "✓"], lost: ["quiet", "–"], declined: ["quiet", "–"],
  leads: ["accent", "★"], standby: ["quiet", "·"], reached: ["well", "●"], "not-reached": ["bad", "✗"],
};

export function State({ of }) {
  const [tone, sign] = STATES[of] ?? ["quiet", "·"];
  return html`<span class="state tone-${tone}"><span class="state-sign" aria-hidden="true">${sign}</span>${tOr(`state.${of}`, of)}</span>`;
}

// A link to a goal, an agent, a conversation.
export function Link({ page, name, children }) {
  if (name === null || name === undefined) return null;
  // The screen of a robot has no other pages.
  if (me.value?.screen) return children ?? html`<${Text} of=${name} />`;
  return html`<a href=${to(page, name)}>${children ?? html`<${Text} of=${name} />`}</a>`;
}

// The heading of a page. A page that is opened by a link puts the focus here, so that a screen
// reader says where one is.
let isFirstPage = true;

export function PageHead({ title, children, about }) {
  const heading = useRef(null);
  useEffect(() => {
    if (isFirstPage) isFirstPage = false;
    else heading.current?.focus({ preventScroll: true });
  }, []);
  return html`<header class="page-head">
    <div class="page-title"><h1 tabindex="-1" ref=${heading}>${title}</h1>${about && html`<p class="muted">${about}</p>`}</div>
    ${children && html`<div class="page-tools">${children}</div>`}
  </header>`;
}

// A part of a page under a heading.
export function Card({ title, children, tone, tools }) {
  return html`<section class="card ${tone ? `card-${tone}` : ""}"><div class="card-head"><h2>${title}</h2>${tools}</div>${children}</section>`;
}

// What is shown while nothing has arrived, or if there is nothing.
export function Empty({ topic, children }) {
  return html`<p class="empty">${topic && !topic.isLoaded ? t("empty.loading") : children}</p>`;
}

// A field by which rows are filtered: all words, in any order.
export function Filter({ value, onInput, label, count }) {
  const id = useId();
  return html`<div class="filter" role="search">
    <label class="hidden-visually" for=${id}>${label}</label>
    <input id=${id} type="search" value=${value} placeholder=${label} autocomplete="off" spellcheck="false"
      onInput=${(event) => onInput(event.target.value)} />
    <span class="muted count" role="status">${count}</span></div>`;
}

// Whether a text has all words of a filter.
export function matches(text, filter) {
  if (!filter) return true;
  const low = text.toLowerCase();
  return filter.toLowerCase().split(/\s+/).every((word) => low.includes(word));
}

// The sentence that says how an act has ended, in the language of the page if it is a fixed one.
export function saidOf(outcome) {
  const message = outcome.message;
  const said = message ? t(`said.${message.key}`, message.values) : null;
  return said === null || said === `said.${message.key}` ? outcome.sentence : said;
}

// How an act has ended, said to a screen reader, too.
export function Outcome({ outcome, children }) {
  return html`<div class="outcome-place" role="status" aria-live="polite">${outcome && html`
    <div class="outcome ${outcome.ok ? "outcome-ok" : "outcome-bad"}">
      <p><${Sign} of=${outcome.ok ? "well" : "bad"} /> <span class="hidden-visually">${outcome.ok ? t("act.done") : t("act.not-done")}: </span><${Text} of=${saidOf(outcome)} /></p>
      ${outcome.conversation && !me.value?.screen && html`<p><a href=${to("goals", outcome.conversation)}>${t("act.to-goal")}</a></p>`}
      ${children}
    </div>`}</div>`;
}

// Carries out an act once at a time: `[run, isBusy, outcome, forget]`.
export function useAct() {
  const [state, setState] = useState({ isBusy: false, outcome: null });
  const isThere = useRef(true);
  useEffect(() => { isThere.current = true; return () => { isThere.current = false; }; }, []);
  const run = async (wanted) => {
    setState({ isBusy: true, outcome: null });
    const outcome = await act(wanted);
    if (isThere.current) setState({ isBusy: false, outcome });
    return outcome;
  };
  return [run, state.isBusy, state.outcome, () => setState({ isBusy: false, outcome: null })];
}

// A button that asks a second time, in its own place, before it does what cannot be undone.
export function AskTwice({ label, sure, onDo, disabled, tone }) {
  const [isAsking, setAsking] = useState(false);
  const yes = useRef(null);
  const first = useRef(null);
  const wasAsking = useRef(false);
  useLayoutEffect(() => {
    if (isAsking) yes.current?.focus();
    else if (wasAsking.current) first.current?.focus();
    wasAsking.current = isAsking;
  }, [isAsking]);
  if (!isAsking) {
    return html`<button type="button" ref=${first} class="button" aria-disabled=${disabled ? "true" : undefined} onClick=${() => disabled || setAsking(true)}>${label}</button>`;
  }
  return html`<span class="ask-twice" role="group" aria-label=${label}>
    <button type="button" ref=${yes} class="button ${tone ?? "danger"}" onClick=${() => { setAsking(false); onDo(); }}>${sure}</button>
    <button type="button" class="button" onClick=${() => setAsking(false)}>${t("act.leave")}</button></span>`;
}

// A list of names and values.
export function Facts({ rows }) {
  return html`<dl class="pairs">${rows.filter((row) => row && row[1] !== null && row[1] !== undefined && row[1] !== "").map(([name, value]) =>
    html`<div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>`;
}

// A link that looks like a button.
export function ButtonLink({ href, children, tone }) {
  return html`<a class="button ${tone ?? ""}" href=${href}>${children}</a>`;
}

// A mistake in one part of a page is said there, and the rest goes on: the stop button stays.
export class Guarded extends Component {
  constructor() {
    super();
    this.state = { problem: null };
  }

  componentDidCatch(problem) {
    console.error(problem);
    this.setState({ problem });
  }

  render({ children }) {
    if (this.state.problem === null) return children;
    return html`<div class="outcome outcome-bad" role="alert"><p>${t("problem.page")}</p>
      <p class="muted"><${Text} of=${this.state.problem.message} /></p>
      <p><button type="button" class="button" onClick=${() => location.reload()}>${t("problem.reload")}</button></p></div>`;
  }
}

export { go };
