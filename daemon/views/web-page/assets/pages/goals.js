// All goals: how each stands, who asked, what is done now, why it waits.

import { html, useState } from "../lib/html.js";
import { t, tOr } from "../lib/language.js";
import { keep, place } from "../lib/router.js";
import { At, Late, Since, when } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { Table } from "../lib/table.js";
import { ButtonLink, Empty, Filter, Link, PageHead, State, Text, Told, matches } from "../lib/ui.js";
import { Said, wordsOf } from "../lib/words.js";

const STAGES = ["all", "open", "waiting", "running", "holding", "scheduled", "ended"];

const columns = () => [
  { key: "number", title: t("goal.number"), width: "3.5rem", class: "wide-only", cell: (row) => (row.number ? String(row.number) : "") },
  { key: "stage", title: t("goal.stage"), width: "8.5rem", cell: (row) => html`<${State} of=${row.stage} />` },
  { key: "goal", title: t("goal.goal"), width: "minmax(0, 2fr)", isMain: true, cell: (row) => html`<${Link} page="goals" name=${row.conversation}><${Said} of=${goalName(row)} /><//>` },
  { key: "now", title: t("goal.now"), width: "minmax(0, 2fr)", cell: (row) => html`<${GoalNow} row=${row} />` },
  { key: "progress", title: t("goal.steps"), width: "5rem", class: "wide-only", cell: (row) => (row.steps > 0 ? `${row.steps_done} / ${row.steps}` : "") },
  { key: "by", title: t("goal.by"), width: "minmax(0, 1fr)", class: "wide-only", cell: (row) => html`<${Text} of=${askerOf(row)} />` },
  { key: "changed", title: t("goal.changed"), width: "6.5rem", class: "wide-only", cell: (row) => html`<${Since} at=${row.changed_at} />` },
];

export function GoalsPage() {
  const topic = useTopic("goals");
  const [filter, setFilter] = useState(place.value.query.get("filter") ?? "");
  const [stage, setStage] = useState(place.value.query.get("stage") ?? "all");
  const [shownColumns] = useState(columns);
  const rows = topic.list.filter(({ row }) => isOf(row, stage) && matches(words(row), filter));
  return html`<${PageHead} title=${t("nav.goals")}><${ButtonLink} href="/ask" tone="primary">${t("nav.ask")}<//><//>
    <div class="toolbar">
      <${Filter} value=${filter} label=${t("filter.goals")} count=${t("filter.count", { n: rows.length })}
        onInput=${(value) => { setFilter(value); keep("filter", value); }} />
      <div class="segments" role="group" aria-label=${t("goal.stage")}>${STAGES.map((one) => html`<button type="button" key=${one}
        class="segment" aria-pressed=${one === stage ? "true" : "false"} onClick=${() => { setStage(one); keep("stage", one === "all" ? "" : one); }}>${t(`stage.${one}`)}</button>`)}</div>
    </div>
    <${Table} label=${t("nav.goals")} columns=${shownColumns} rows=${rows} topic=${topic} empty=${t("empty.goals")} />`;
}

function words(row) {
  return [row.number, row.goal, wordsOf(row.goal), row.stage, row.text, askerOf(row), ...row.now, row.conversation].join(" ");
}

function isOf(row, stage) {
  const hasEnded = row.ended_at !== null && row.ended_at !== undefined;
  if (stage === "all") return true;
  if (stage === "open") return !hasEnded;
  if (stage === "ended") return hasEnded;
  if (stage === "running") return row.stage === "running" || row.stage === "planning";
  return row.stage === stage;
}

// The name of a goal for people: its condition, or its conversation if it was not observed.
export function goalName(row) {
  return row.goal || row.conversation;
}

// Who asked for a goal: an agent, or the ecosystem file.
export function askerOf(row) {
  return row.is_of_file ? t("goal.by-file") : row.requester ?? "";
}

// What is done for a goal now, or why it stands as it does.
export function GoalNow({ row }) {
  if (row.stage === "scheduled") return html`<${Due} due=${row.due} />`;
  return html`<span><${Told} of=${row.now.length > 0 ? row.now.join("; ") : row.text} /><${Late} row=${row} /></span>`;
}

// When a goal by the clock is asked for next, its times in the words of whoever wrote them, and the
// goal that is pursued for it.
export function Due({ due }) {
  if (!due) return null;
  const next = due.next_at ? t("goal.next", { time: when(due.next_at) }) : t("goal.no-next");
  return html`<span>${next}${due.words && html` <span class="muted">(<${Text} of=${due.words} />)</span>`}${due.pursued
    && html` · <${Link} page="goals" name=${due.pursued}>${t("goal.pursued")}<//>`}</span>`;
}

// Goals as short cards, for the overview.
export function GoalCards({ rows, topic }) {
  if (rows.length === 0) return html`<${Empty} topic=${topic}>${t("empty.open-goals")}<//>`;
  return html`<ul class="goal-cards">${rows.map(({ key, row }) => html`<li key=${key} class="goal-card">
    <div class="goal-card-head"><a href=${`/goals/${encodeURIComponent(row.conversation)}`}><${Said} of=${goalName(row)} /></a><${State} of=${row.stage} /></div>
    <p class="goal-card-now"><${GoalNow} row=${row} /></p>
    ${row.steps > 0 && html`<progress max=${row.steps} value=${row.steps_done} aria-label=${t("goal.progress", { done: row.steps_done, steps: row.steps })}></progress>`}
    <p class="muted small">${row.number && `${t("goal.numbered", { number: row.number })} `}${askerOf(row) && html`${t("goal.asked-by")} <${Text} of=${askerOf(row)} /> `}${row.asked_at && html`<${At} at=${row.asked_at} /> `}
      ${row.expected_end && html`· ${t("goal.expected-end")} <${At} at=${row.expected_end} />`}</p></li>`)}</ul>`;
}

// Whether a goal is kept, in words.
export function keepWords(keep) {
  return keep ? tOr(`keep.${typeof keep === "string" ? keep : "other"}`, String(keep)) : "";
}
