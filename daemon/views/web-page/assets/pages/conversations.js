// All conversations, and one as a sequence diagram with its messages.

import { html, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { keep, place } from "../lib/router.js";
import { At, Since } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { SmallTable, Table } from "../lib/table.js";
import { Card, Empty, Filter, Link, PageHead, Text, matches } from "../lib/ui.js";
import { line } from "../lib/visible.js";

const columns = () => [
  { key: "subject", title: t("conversation.subject"), width: "minmax(0, 2.4fr)", isMain: true, cell: (row) => html`<${Link} page="conversations" name=${row.conversation}><${Text} of=${row.subject || row.conversation} /><//>` },
  { key: "protocols", title: t("conversation.protocols"), width: "minmax(0, 1fr)", cell: (row) => html`<span class="muted"><${Text} of=${row.protocols.join(", ")} /></span>` },
  { key: "messages", title: t("conversation.messages"), width: "6rem", class: "number", cell: (row) => row.messages },
  { key: "people", title: t("conversation.participants"), width: "6rem", class: "wide-only number", cell: (row) => row.participants },
  { key: "turn", title: t("conversation.out-of-turn"), width: "7rem", class: "wide-only", cell: (row) => (row.out_of_turn > 0 ? html`<span class="problem">✗ ${row.out_of_turn}</span>` : "") },
  { key: "last", title: t("conversation.last"), width: "6.5rem", class: "wide-only", cell: (row) => html`<${Since} at=${row.last_at} />` },
];

export function ConversationsPage() {
  const topic = useTopic("conversations");
  const [filter, setFilter] = useState(place.value.query.get("filter") ?? "");
  const [shownColumns] = useState(columns);
  const rows = topic.list.filter(({ row }) => matches([row.subject, row.conversation, ...row.protocols].join(" "), filter));
  return html`<${PageHead} title=${t("nav.conversations")} />
    <div class="toolbar"><${Filter} value=${filter} label=${t("filter.conversations")} count=${t("filter.count", { n: rows.length })} onInput=${(value) => { setFilter(value); keep("filter", value); }} /></div>
    <${Table} label=${t("nav.conversations")} columns=${shownColumns} rows=${rows} topic=${topic} empty=${t("empty.conversations")} />`;
}

export function ConversationPage({ name }) {
  const topic = useTopic(`conversation:${name}`);
  const goals = useTopic("goals");
  const detail = topic.one;
  if (!detail) return html`<${PageHead} title=${t("conversation.title")} /><${Empty} topic=${topic}>${t("empty.conversation")}<//>`;
  const isGoal = goals.rows.has(detail.row.conversation);
  return html`<${PageHead} title=${html`<${Text} of=${detail.row.subject || detail.row.conversation} />`} about=${t("conversation.title")}>
      ${isGoal && html`<a class="button" href=${`/goals/${encodeURIComponent(detail.row.conversation)}`}>${t("act.to-goal")}</a>`}<//>
    ${detail.dropped > 0 && html`<p class="muted">${t("conversation.dropped", { n: detail.dropped })}</p>`}
    <${Card} title=${t("conversation.diagram")}><${Sequence} detail=${detail} /><//>
    <${Card} title=${t("conversation.messages")}><${SmallTable} label=${t("conversation.messages")} head=${[t("conversation.at"), t("conversation.from"), t("conversation.to"), t("conversation.performative"), t("conversation.summary")]}
      rows=${detail.messages.map((message) => [
        html`<${At} at=${message.at} />`, html`<${Text} of=${message.from} />`, html`<${Text} of=${message.to.length > 0 ? message.to.join(", ") : t("conversation.all")} />`,
        html`<${Text} of=${message.performative} />`,
        html`<${Text} of=${message.summary} />${message.out_of_turn && html` <span class="problem">✗ ${t("conversation.broke")}: <${Text} of=${message.out_of_turn} /></span>`}`])} /><//>`;
}

const LANE = 170;
const ROW = 30;
const HEAD = 34;

// Draws the messages as arrows between lanes. The table below says the same in words.
function Sequence({ detail }) {
  const lanes = new Map(detail.lanes.map((lane, at) => [lane, LANE / 2 + at * LANE]));
  const width = Math.max(1, detail.lanes.length) * LANE;
  const height = HEAD + detail.messages.length * ROW + 10;
  const short = (text, length) => { const shown = line(text); return shown.length > length ? `${shown.slice(0, length - 1)}…` : shown; };
  return html`<div class="scroll sequence" tabindex="0" role="group" aria-label=${t("conversation.diagram")}>
    <svg width=${width} height=${height} viewBox=${`0 0 ${width} ${height}`} aria-hidden="true">
      ${detail.lanes.map((lane) => html`<g key=${lane}><line class="lane" x1=${lanes.get(lane)} x2=${lanes.get(lane)} y1=${HEAD - 8} y2=${height} /><text class="lane-name" x=${lanes.get(lane)} y="16" text-anchor="middle">${short(lane, 22)}</text></g>`)}
      ${detail.messages.map((message, at) => html`<${Arrows} key=${at} message=${message} y=${HEAD + at * ROW + 18} lanes=${lanes} short=${short} />`)}
    </svg></div>`;
}

function Arrows({ message, y, lanes, short }) {
  const from = lanes.get(message.from);
  if (from === undefined) return null;
  const targets = (message.to.length > 0 ? message.to.map((name) => lanes.get(name)) : [...lanes.values()]).filter((x) => x !== undefined && x !== from);
  const left = Math.min(from, ...targets);
  const right = Math.max(from, ...targets);
  const room = Math.max(18, Math.floor((right - left) / 6.6));
  return html`<g class="message ${message.out_of_turn ? "message-broken" : ""}">
    <circle cx=${from} cy=${y} r="3.5" />
    <line x1=${left} x2=${right} y1=${y} y2=${y} />
    ${targets.map((x, at) => html`<path key=${at} d=${x > from ? `M${x - 7} ${y - 4}L${x} ${y}L${x - 7} ${y + 4}` : `M${x + 7} ${y - 4}L${x} ${y}L${x + 7} ${y + 4}`} />`)}
    <text x=${targets.length > 0 ? (left + right) / 2 : from + 8} y=${y - 6} text-anchor=${targets.length > 0 ? "middle" : "start"}>${short(`${message.out_of_turn ? "✗ " : ""}${message.performative}${message.summary ? `: ${message.summary}` : ""}`, room)}</text>
    <title>${line(message.summary)}</title></g>`;
}
