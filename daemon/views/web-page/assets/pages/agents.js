// All agents: who is present, what each does now, and its problems.

import { html, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { keep, place } from "../lib/router.js";
import { Late, Since } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { Table } from "../lib/table.js";
import { Filter, Link, PageHead, State, Text, Told, matches } from "../lib/ui.js";

const STATES = ["all", "busy", "present", "missing", "problems"];

const columns = () => [
  { key: "state", title: t("agent.state"), width: "8.5rem", cell: (row) => html`<${State} of=${agentState(row)} />` },
  { key: "agent", title: t("agent.agent"), width: "minmax(0, 1.2fr)", isMain: true, cell: (row) => html`<${Link} page="agents" name=${row.agent} />` },
  { key: "doing", title: t("agent.doing"), width: "minmax(0, 2fr)", cell: (row) => html`<${Doing} row=${row} />` },
  { key: "daemon", title: t("agent.daemon"), width: "minmax(0, 1fr)", class: "wide-only", cell: (row) => html`<${Text} of=${row.daemon ?? ""} />` },
  { key: "beat", title: t("agent.beat"), width: "6rem", class: "wide-only", cell: (row) => (row.heartbeat_at ? html`<${Since} at=${row.heartbeat_at} />` : "") },
  { key: "mail", title: t("agent.mail"), width: "4.5rem", class: "wide-only number", cell: (row) => row.waiting ?? "" },
];

export function AgentsPage() {
  const topic = useTopic("agents");
  const [filter, setFilter] = useState(place.value.query.get("filter") ?? "");
  const [state, setState] = useState(place.value.query.get("state") ?? "all");
  const [shownColumns] = useState(columns);
  const isAll = state === "all" && filter === "";
  const rows = isAll ? topic.list : topic.list.filter(({ row }) => isOf(row, state) && matches(words(row), filter));
  return html`<${PageHead} title=${t("nav.agents")} />
    <div class="toolbar">
      <${Filter} value=${filter} label=${t("filter.agents")} count=${t("filter.count", { n: rows.length })}
        onInput=${(value) => { setFilter(value); keep("filter", value); }} />
      <div class="segments" role="group" aria-label=${t("agent.state")}>${STATES.map((one) => html`<button type="button" key=${one}
        class="segment" aria-pressed=${one === state ? "true" : "false"} onClick=${() => { setState(one); keep("state", one === "all" ? "" : one); }}>${t(`agents.${one}`)}</button>`)}</div>
    </div>
    <${Table} label=${t("nav.agents")} columns=${shownColumns} rows=${rows} topic=${topic} empty=${t("empty.agents")} />`;
}

// The state of an agent in one word: stopped and busy say more than present.
export function agentState(row) {
  if (row.is_stopped) return "stopped";
  return row.presence === "present" && row.doing ? "busy" : row.presence;
}

function isOf(row, state) {
  if (state === "busy") return Boolean(row.doing);
  if (state === "present") return row.presence === "present";
  if (state === "missing") return ["gone", "silent", "absent"].includes(row.presence);
  return state === "all" || row.problems.length > 0;
}

function words(row) {
  return [row.agent, agentState(row), row.presence, row.daemon, row.doing, ...row.problems, ...row.actions].join(" ");
}

function Doing({ row }) {
  if (row.doing) {
    return html`<span><${Text} of=${row.doing} />${row.doing_since && html` <span class="muted">· <${Since} at=${row.doing_since} /></span>`}<${Late} row=${row} /></span>`;
  }
  return row.problems.length > 0 ? html`<span class="problem"><${Told} of=${row.problems[0]} /></span>`
    : html`<span class="muted"><${Text} of=${row.actions.join(", ")} /></span>`;
}
