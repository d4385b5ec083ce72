// The stop button, in the same place on every page, and what became of a stop. It asks nothing first:
// pressed, everything is to stop. This is no safety function; docs/stops.md says what it is.

import { act, may, me } from "./api.js";
import { html, useRef, useState } from "./html.js";
import { t, tOr } from "./language.js";
import { Followed, useFollowed } from "./state.js";
import { At } from "./time.js";
import { useTopic } from "./topics.js";
import { SmallTable } from "./table.js";
import { Link, Outcome, Sign, Text, saidOf, useAct } from "./ui.js";

// Tries to reach the daemon with a stop: a lost connection must not swallow it.
const TRIES = 3;

// Agents whose effect is shown: those first that a person has to look at.
const EFFECTS_MAX = 60;

// What became of the last stop that was pressed here: `null`, `{ isAsked }` or `{ outcome }`.
const pressed = new Followed(null);

async function press() {
  pressed.set({ isAsked: true });
  let outcome = null;
  for (let attempt = 0; attempt < TRIES; attempt += 1) {
    // The screen of a robot stops this robot.
    const names = me.value?.screen ? [me.value.screen] : [];
    outcome = await act({ act: "stop", names, because: t("stop.because-page") });
    if (outcome.ok || outcome.status !== 0) break;
  }
  pressed.set({ outcome });
}

// The button. While one stop is under way, a further press asks again.
export function StopButton() {
  const state = useFollowed(pressed);
  const isAsked = state?.isAsked ?? false;
  return html`<button type="button" class="stop-button ${isAsked ? "is-asked" : ""}" onClick=${press}>
    <svg viewBox="0 0 20 20" aria-hidden="true" class="stop-sign"><path d="M6 1h8l5 5v8l-5 5H6l-5-5V6z" /></svg><span>${isAsked ? t("stop.asked") : me.value?.screen ? t("stop.button-robot") : t("stop.button")}</span></button>`;
}

// What the last stop did, and the stops in force, above every page.
export function StopPanel() {
  const state = useFollowed(pressed);
  const stops = useTopic("stops");
  const outcome = state?.outcome;
  const tone = outcome ? `stop-panel ${outcome.ok ? "" : "stop-panel-failed"}` : "";
  return html`<div class="stop-panel-place"><div class=${tone}>
      <div role="alert">${outcome && html`<p class="stop-said"><${Sign} of=${outcome.ok ? "well" : "bad"} /> <strong>${outcome.status === undefined ? "" : `${t("stop.not-asked")} `}<${Text} of=${saidOf(outcome)} /></strong></p>`}</div>
      ${outcome && html`<${Effects} detail=${outcome.detail} />
        <p><button type="button" class="button" onClick=${() => pressed.set(null)}>${t("stop.close")}</button></p>`}</div>
    ${stops.list.length > 0 && html`<${InForce} stops=${stops.list} />`}</div>`;
}

function Effects({ detail }) {
  const agents = Array.isArray(detail) ? detail : detail?.agents;
  if (!Array.isArray(agents) || agents.length === 0) return null;
  const rows = agents.map((one) => ({ ...one, effect: effectOf(one) })).sort((one, other) => urgency(one) - urgency(other));
  // Open if there is something to look at.
  return html`<details open=${rows.some((one) => urgency(one) === 0)}><summary>${t("stop.effects")} (${rows.length})</summary><${SmallTable} label=${t("stop.effects")} head=${[t("agent.agent"), t("stop.effect"), t("stop.detail")]}
    rows=${rows.slice(0, EFFECTS_MAX).map((one) => [html`<${Link} page="agents" name=${one.agent} />`, html`<${Text} of=${tOr(`effect.${one.effect}`, one.effect)} />`, html`<${Text} of=${one.detail ?? ""} />`])} />
    ${rows.length > EFFECTS_MAX && html`<p class="muted">${t("stop.more", { n: rows.length - EFFECTS_MAX })}</p>`}</details>`;
}

// The effect on one agent; a daemon may say only whether the agent has stopped.
function effectOf(one) {
  return one.effect ?? (one.stopped ? "ended" : "doubtful");
}

// What a person has to look at comes first: agents of which it is not known that they stand still.
function urgency(one) {
  return { done: 1, ended: 1, still: 2, unconcerned: 3 }[one.effect] ?? 0;
}

function InForce({ stops }) {
  const [run, isBusy, outcome] = useAct();
  const place = useRef(null);
  const [isOpen, setOpen] = useState(false);
  const rows = stops.map(({ row }) => ({ at: row.at, holders: row.holders, ...(row.stop ?? row) }));
  const release = async (ids) => { await run({ act: "release", ids }); place.current?.focus(); };
  return html`<section class="stops-in-force" aria-label=${t("stop.in-force", { n: rows.length })} ref=${place} tabindex="-1">
    <p><span aria-hidden="true">■ </span><strong>${t("stop.in-force", { n: rows.length })}</strong>
      ${rows.length > 1 && html` <button type="button" class="button small-button" aria-expanded=${isOpen ? "true" : "false"} onClick=${() => setOpen(!isOpen)}>${isOpen ? t("stop.fewer") : t("stop.each")}</button>`}
      ${may("stop") && rows.length > 1 && html` <button type="button" class="button small-button" disabled=${isBusy} onClick=${() => release(rows.map((row) => row.id))}>${t("stop.release-all")}</button>`}</p>
    <ul class="plain">${(isOpen ? rows : rows.slice(0, 1)).map((row) => html`<li key=${row.id}>${(row.scope ?? []).length > 0 ? html`<${Text} of=${row.scope.join(", ")} />` : t("stop.everything")}${" "}
      · ${t("stop.by")} <${Text} of=${row.by} />${row.why && html` · <${Text} of=${row.why} />`}${row.at && html` · <${At} at=${row.at} />`}
      ${may("stop") && html` <button type="button" class="button small-button" disabled=${isBusy} onClick=${() => release([row.id])}>${t("stop.release")}</button>`}</li>`)}</ul>
    <${Outcome} outcome=${outcome} /></section>`;
}
