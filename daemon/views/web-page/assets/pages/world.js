// All facts: who says so, since when, for how long it is known, who contradicts; and a chart of a
// value.

import { get, may } from "../lib/api.js";
import { Chart } from "../lib/chart.js";
import { html, useEffect, useId, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { keep, place } from "../lib/router.js";
import { seen } from "../lib/series.js";
import { Since, Until, now, useNow } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { SmallTable, Table } from "../lib/table.js";
import { useFollowed } from "../lib/state.js";
import { Card, Facts, Filter, Link, Outcome, PageHead, State, Text, matches, useAct } from "../lib/ui.js";
import { Said, SaidFact, wordsOf } from "../lib/words.js";

const FRESHNESS = ["all", "unknown", "stale", "disputed"];

const columns = () => [
  { key: "fact", title: t("fact.fact"), width: "minmax(0, 2.4fr)", isMain: true, cell: (row) => html`<a href=${`/world?fact=${encodeURIComponent(factKey(row))}`}><${SaidFact} row=${row} /></a>` },
  { key: "truth", title: t("fact.truth"), width: "8rem", cell: (row) => html`<${State} of=${row.truth} />` },
  { key: "fresh", title: t("fact.freshness"), width: "8rem", cell: (row) => (row.contradictions.length > 0 ? html`<${State} of="disputed" />` : html`<${State} of=${row.freshness} />`) },
  { key: "owner", title: t("fact.owner"), width: "minmax(0, 1fr)", class: "wide-only", cell: (row) => html`<${Text} of=${row.owners.join(", ")} />` },
  { key: "since", title: t("fact.same-for"), width: "7rem", class: "wide-only", cell: (row) => html`<${Since} at=${row.same_since} />` },
  { key: "age", title: t("fact.age"), width: "6rem", class: "wide-only", cell: (row) => html`<${Since} at=${row.reported_at} />` },
];

export function WorldPage() {
  const topic = useTopic("facts");
  const [filter, setFilter] = useState(place.value.query.get("filter") ?? "");
  const [kind, setKind] = useState(place.value.query.get("kind") ?? "all");
  const [shownColumns] = useState(columns);
  const where = useFollowed(place);
  const chosen = where.query.get("fact");
  const isAll = kind === "all" && filter === "";
  const rows = isAll ? topic.list : topic.list.filter(({ row }) => isOf(row, kind) && matches(words(row), filter));
  return html`<${PageHead} title=${t("nav.world")} />
    ${chosen !== null && html`<${FactDetail} fact=${chosen} topic=${topic} />`}
    <div class="toolbar">
      <${Filter} value=${filter} label=${t("filter.facts")} count=${t("filter.count", { n: rows.length })}
        onInput=${(value) => { setFilter(value); keep("filter", value); }} />
      <div class="segments" role="group" aria-label=${t("fact.freshness")}>${FRESHNESS.map((one) => html`<button type="button" key=${one}
        class="segment" aria-pressed=${one === kind ? "true" : "false"} onClick=${() => { setKind(one); keep("kind", one === "all" ? "" : one); }}>${t(`facts.${one}`)}</button>`)}</div>
    </div>
    <${Table} label=${t("nav.world")} columns=${shownColumns} rows=${rows} topic=${topic} empty=${t("empty.facts")} />
    ${may("change") && html`<${SetFact} />`}`;
}

// The key of a fact: its predicate or function with the arguments, without a value.
function factKey(row) {
  return `(${[row.predicate, ...row.arguments].join(" ")})`;
}

function isOf(row, kind) {
  if (kind === "unknown") return row.truth === "unknown";
  if (kind === "stale") return row.freshness === "stale" || row.freshness === "ending";
  return kind === "all" || row.contradictions.length > 0;
}

function words(row) {
  return [row.fact, wordsOf(row.fact), row.truth, row.freshness, ...row.owners].join(" ");
}

// Values that the history keeps: of the last day, at most so many.
const HISTORY_MS = 24 * 3600 * 1000;
const HISTORY_VALUES = 500;

// Returns the values of a fact that the history keeps, oldest first; `null` if there is no history.
function useHistory(fact) {
  const [found, setFound] = useState(null);
  useEffect(() => {
    let isThere = true;
    const query = new URLSearchParams({ values: fact, from: String(Math.round(now() - HISTORY_MS)), limit: String(HISTORY_VALUES) });
    const take = ({ events }) => {
      const values = (events ?? []).filter((event) => typeof event.value === "number").map((event) => ({ at: event.at, value: event.value }));
      if (isThere) setFound(values.sort((one, other) => one.at - other.at));
    };
    setFound(null);
    get(`/api/history?${query}`).then(take, () => {});
    return () => { isThere = false; };
  }, [fact]);
  return found;
}

function FactDetail({ fact, topic }) {
  const present = useNow();
  const history = useHistory(fact);
  const activity = useTopic("activity");
  const found = topic.rows.get(fact);
  if (!found) return html`<${Card} title=${html`<${Text} of=${fact} />`}><p class="empty">${topic.isLoaded ? t("empty.fact") : t("empty.loading")}</p><p><a href="/world">${t("fact.close")}</a></p><//>`;
  const here = seen(fact);
  const first = here.length > 0 ? here[0].at : Infinity;
  const kept = (history ?? []).filter((point) => point.at < first);
  const points = [...kept, ...here];
  // What was done for goals meanwhile: a value often changes because of it.
  const marks = activity.list.filter(({ row }) => row.conversation).map(({ row }) => ({ at: row.at, text: row.text }));
  return html`<${Card} title=${html`<${SaidFact} row=${found} />`} tools=${html`<a href="/world">${t("fact.close")}</a>`}>
    <${Facts} rows=${[
      [t("goal.pddl"), html`<code><${Text} of=${found.fact} /></code>`],
      [t("fact.truth"), html`<${State} of=${found.truth} />`],
      [t("fact.freshness"), html`<${State} of=${found.freshness} />`],
      [t("fact.owner"), found.owners.map((owner, at) => html`<span key=${at}>${at > 0 && ", "}${owner === "the map" || owner === "axiom" ? owner : html`<${Link} page="agents" name=${owner} />`}</span>`)],
      [t("fact.same-for"), found.same_since && html`<${Since} at=${found.same_since} />`],
      [t("fact.age"), found.reported_at && html`<${Since} at=${found.reported_at} />`],
      [t("fact.known-for"), found.known_until && html`<${Until} at=${found.known_until} />`],
    ]} />
    ${found.contradictions.length > 0 && html`<${SmallTable} label=${t("fact.contradictions")} head=${[t("fact.owner"), t("fact.fact"), t("fact.source")]}
      rows=${found.contradictions.map((claim) => [html`<${Text} of=${claim.owner} />`, html`<${Said} of=${claim.fact} />`, html`<${Text} of=${claim.source} />`])} />`}
    ${typeof found.value === "number" && html`<${Chart} label=${[found.predicate, ...found.arguments].join(" ")} points=${points} marks=${marks} until=${present} />`}
  <//>`;
}

// Sets a fact, as `althing set` does.
function SetFact() {
  const [run, isBusy, outcome] = useAct();
  const [fact, setFact] = useState("");
  const id = useId();
  return html`<${Card} title=${t("set.title")}><p class="muted">${t("set.about")}</p>
    <form class="inline-form" onSubmit=${(event) => { event.preventDefault(); run({ act: "set", fact }); }}>
      <label for=${id}>${t("fact.fact")}</label><input id=${id} value=${fact} spellcheck="false" autocomplete="off" placeholder="(door-open office1)" onInput=${(event) => setFact(event.target.value)} />
      <button class="button" disabled=${isBusy || fact.trim() === ""}>${t("set.do")}</button></form>
    <${Outcome} outcome=${outcome} /><//>`;
}
