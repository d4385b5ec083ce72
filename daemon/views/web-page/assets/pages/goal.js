// One goal: its plans as Gantt charts with done, now and next, planned against actual; the bids; the
// history; and the button that cancels it.

import { may } from "../lib/api.js";
import { html } from "../lib/html.js";
import { t, tOr } from "../lib/language.js";
import { At, Late, Since, clock, duration, number, useNow, when } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { SmallTable } from "../lib/table.js";
import { AskTwice, Card, Empty, Facts, Link, Outcome, PageHead, State, Text, Told, useAct } from "../lib/ui.js";
import { line } from "../lib/visible.js";
import { Said } from "../lib/words.js";
import { Due, askerOf, goalName, keepWords } from "./goals.js";

export function GoalPage({ name }) {
  const topic = useTopic(`goal:${name}`);
  const [run, isBusy, outcome] = useAct();
  const detail = topic.one;
  if (!detail) return html`<${PageHead} title=${t("goal.title")} /><${Empty} topic=${topic}>${t("empty.goal")}<//>`;
  const row = detail.row;
  const hasEnded = row.ended_at !== null && row.ended_at !== undefined;
  return html`<${PageHead} title=${html`<span class="goal-name"><${Said} of=${goalName(row)} /></span>`} about=${row.number ? t("goal.numbered", { number: row.number }) : t("goal.title")}>
      ${!hasEnded && may("ask") && html`<${AskTwice} label=${t("goal.cancel")} sure=${t("goal.cancel-sure")} disabled=${isBusy}
        onDo=${() => run({ act: "cancel-goal", conversation: row.conversation })} />`}
    <//>
    <${Outcome} outcome=${outcome} />
    <div class="lead"><${State} of=${row.stage} /> ${row.stage === "scheduled" ? html`<${Due} due=${row.due} />` : html`<${Told} of=${row.text} />`}<${Late} row=${row} /></div>
    <${Facts} rows=${[
      [t("goal.pddl"), row.goal && html`<code><${Text} of=${row.goal} /></code>`],
      [t("goal.by"), askerOf(row) && html`<${Text} of=${askerOf(row)} />`],
      [t("goal.asked-at"), row.asked_at && html`<${At} at=${row.asked_at} />`],
      [t("goal.mode"), keepWords(row.keep)],
      [t("goal.priority"), row.priority !== 0 ? number(row.priority) : null],
      [t("goal.phase"), row.phase && tOr(`phase.${row.phase}`, row.phase)],
      [t("goal.changed"), html`<${Since} at=${row.changed_at} />`],
      [t("goal.expected-end"), row.expected_end && html`<${At} at=${row.expected_end} />`],
      [t("goal.reach-by"), row.due?.reach_by && when(row.due.reach_by)],
      [t("goal.given-up-at"), row.due?.given_up_at && when(row.due.given_up_at)],
      [t("goal.ended-at"), row.ended_at && html`<${At} at=${row.ended_at} />`],
      [t("goal.conversation"), html`<${Link} page="conversations" name=${row.conversation}>${t("goal.messages")}<//>`],
    ]} />
    ${detail.plans.length === 0 && row.stage !== "scheduled" && html`<p class="empty">${t("empty.plans")}</p>`}
    ${detail.plans.map((plan) => html`<${Plan} key=${`${plan.term}/${plan.round}`} plan=${plan} />`)}
    ${detail.calls.length > 0 && html`<${Card} title=${t("goal.bids")}>${detail.calls.map((call, at) => html`<${Call} key=${at} call=${call} />`)}<//>`}
    <${Card} title=${t("goal.history")}>
      <ol class="history">${detail.history.map((event, at) => html`<li key=${at}><${At} at=${event.at} /> <${Text} of=${event.text} /></li>`)}</ol>
      ${detail.history.length === 0 && html`<p class="empty">${t("empty.nothing")}</p>`}
    <//>`;
}

function Plan({ plan }) {
  const about = [
    t("plan.steps", { n: plan.steps.length + plan.more_steps }),
    plan.cost !== null && t("plan.cost", { cost: number(plan.cost) }),
    plan.outcome && tOr(`outcome.${plan.outcome}`, plan.outcome),
  ].filter(Boolean).join(" · ");
  return html`<${Card} title=${t("plan.title", { n: plan.round })} tools=${html`<span class="muted">${about} <${Late} row=${plan} /></span>`}>
    ${plan.ended_because && html`<p><${Text} of=${plan.ended_because} /></p>`}
    <${Gantt} plan=${plan} />
    ${plan.more_steps > 0 && html`<p class="muted">${t("plan.more-steps", { n: plan.more_steps })}</p>`}<//>`;
}

// Distances of the lines on the time axis, in milliseconds: a chart has at most five.
const TICKS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 21600, 43200, 86400].map((s) => s * 1000);

// Share of the axis up to which its lines have a time beside them: farther right there is no room.
const LABELS_UNTIL = 0.9;

// Draws a plan as rows of bars. The table beside the bars says the same in words.
function Gantt({ plan }) {
  const present = useNow();
  const isRunning = plan.ended_at === null || plan.ended_at === undefined;
  const latest = plan.steps.reduce((end, step) => Math.max(end, step.ended_at ?? 0, step.expected_end ?? 0), 0);
  const from = plan.begins_at;
  const until = Math.max(plan.ends_at, latest, isRunning ? present : 0, from + 1000);
  const span = (until - from) * 1.02;
  const at = (moment) => `${Math.min(100, Math.max(0, ((moment - from) / span) * 100))}%`;
  const tick = TICKS.find((one) => span / one <= 5) ?? 7 * 86400000;
  const ticks = Array.from({ length: Math.floor(span / tick) + 1 }, (_, n) => n * tick);
  const context = { at, present, from, until };
  return html`<div class="gantt-scroll"><table class="gantt"><caption class="hidden-visually">${t("plan.caption", { n: plan.round })}</caption>
    <thead><tr><th scope="col">${t("plan.step")}</th><th scope="col">${t("plan.state")}</th><th scope="col" class="number">${t("plan.time")}</th>
      <th scope="col" class="gantt-axis"><span class="hidden-visually">${t("plan.chart")}</span><div class="gantt-track" aria-hidden="true">
        ${ticks.filter((offset) => offset < span * LABELS_UNTIL).map((offset) => html`<span key=${offset} class="gantt-tick" style=${{ left: at(from + offset) }}>${offset === 0 ? clock(from) : `+${duration(offset)}`}</span>`)}
      </div></th></tr></thead>
    <tbody>${plan.steps.map((step) => html`<${Step} key=${step.number} step=${step} context=${context} ticks=${ticks} isRunning=${isRunning} />`)}</tbody></table>
    <p class="legend muted small" aria-hidden="true">${["done", "running", "late", "next", "usual"].map((kind) => html`<span key=${kind} class="legend-part"><span class="bar-key bar-${kind}"></span>${t(`plan.key-${kind}`)}</span> `)}</p></div>`;
}

function Step({ step, context, ticks, isRunning }) {
  const { at, present, from } = context;
  return html`<tr class="gantt-step step-${step.state}">
    <td class="gantt-text"><span title=${line(step.step)}><${Text} of=${step.text} /></span>${step.detail && html` <span class="muted small"><${Text} of=${step.detail} /></span>`}</td>
    <td><${State} of=${step.state} /></td>
    <td class="number">${timeOf(step, present)}<${Late} row=${step} /></td>
    <td class="gantt-cell"><div class="gantt-track" aria-hidden="true">
      ${ticks.map((offset) => html`<span key=${offset} class="gantt-line" style=${{ left: at(from + offset) }}></span>`)}
      ${bars(step, present).map((bar, n) => html`<span key=${`bar${n}`} class="bar bar-${bar.kind}" style=${{ left: at(bar.from), width: `calc(${at(bar.to)} - ${at(bar.from)})` }}></span>`)}
      ${isRunning && html`<span class="gantt-now" style=${{ left: at(present) }}></span>`}
    </div></td></tr>`;
}

// The time that a step has taken or takes, or is expected to take.
function timeOf(step, present) {
  if (step.started_at === null || step.started_at === undefined) return step.usual_ms ? `~${duration(step.usual_ms)}` : "";
  if (step.ended_at) return duration(step.ended_at - step.started_at);
  return duration(Math.floor(Math.max(0, present - step.started_at) / 1000) * 1000);
}

// The bars of a step: what was done, the part beyond the usual time, what is expected, and the usual
// time as an outline to compare with.
function bars(step, present) {
  const started = step.started_at;
  if (started === null || started === undefined) {
    return step.expected_start && step.expected_end ? [{ kind: "next", from: step.expected_start, to: step.expected_end }] : [];
  }
  const end = step.ended_at ?? present;
  const usual = step.usual_ms ? started + step.usual_ms : null;
  const isLate = (step.late_ms > 0 || step.late_since > 0) && usual !== null && usual < end;
  const kind = { running: "running", failed: "failed", refused: "failed", cancelled: "cancelled" }[step.state] ?? "done";
  const found = [{ kind, from: started, to: isLate ? usual : end }];
  if (isLate) found.push({ kind: "late", from: usual, to: end });
  if (!step.ended_at && step.expected_end > end) found.push({ kind: "next", from: end, to: step.expected_end });
  if (usual !== null) found.push({ kind: "usual", from: started, to: usual });
  return found;
}

function Call({ call }) {
  const about = call.called ? t("call.to", { agent: "" }) : t("call.to-all");
  return html`<div class="call"><p><${At} at=${call.at} /> ${about}${call.called && html` <${Text} of=${call.called} />`}: ${call.conjuncts.map((conjunct, at) => html`<span key=${at}>${at > 0 && ", "}<${Said} of=${conjunct} /></span>`)}</p>
    <${SmallTable} label=${t("goal.bids")} head=${[t("bid.agent"), t("bid.state"), t("bid.after"), t("bid.cost"), t("bid.why")]} empty=${t("empty.bids")}
      rows=${call.bids.map((bid) => [
        html`<${Link} page="agents" name=${bid.agent} />`,
        html`<${State} of=${bid.state} />`,
        duration(bid.after_ms),
        bid.proposals.map((proposal) => number(proposal.cost)).join(", "),
        html`<${Text} of=${bid.detail || (bid.proposals.find((one) => one.is_chosen) ?? bid.proposals[0])?.steps.join(" ") || ""} />`,
      ])} />
    ${call.more_bids > 0 && html`<p class="muted">${t("call.more-bids", { n: call.more_bids })}</p>`}</div>`;
}
