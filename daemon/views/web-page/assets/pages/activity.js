// What happened, in sentences.

import { html, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { keep, place, to } from "../lib/router.js";
import { clock } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { told } from "../lib/told.js";
import { Empty, Filter, PageHead, Sign, Told, matches } from "../lib/ui.js";

// Entries that are drawn; the filter finds the others.
const SHOWN = 200;

export function ActivityPage() {
  const topic = useTopic("activity");
  const [filter, setFilter] = useState(place.value.query.get("filter") ?? "");
  const [level, setLevel] = useState(place.value.query.get("level") ?? "all");
  const rows = topic.list.filter(({ row }) => (level === "all" || row.level !== "routine") && (level !== "problem" || row.level === "problem") && matches(`${row.text} ${told(row.text)}`, filter));
  return html`<${PageHead} title=${t("nav.activity")} />
    <div class="toolbar">
      <${Filter} value=${filter} label=${t("filter.activity")} count=${t("filter.count", { n: rows.length })} onInput=${(value) => { setFilter(value); keep("filter", value); }} />
      <div class="segments" role="group" aria-label=${t("activity.level")}>${["all", "notable", "problem"].map((one) => html`<button type="button" key=${one} class="segment"
        aria-pressed=${one === level ? "true" : "false"} onClick=${() => { setLevel(one); keep("level", one === "all" ? "" : one); }}>${t(`activity.${one}`)}</button>`)}</div>
    </div>
    <div role="log" aria-live="polite" aria-label=${t("nav.activity")} tabindex="0" class="log"><${ActivityList} entries=${rows.slice(-SHOWN).reverse()} topic=${topic} /></div>
    ${rows.length > SHOWN && html`<p class="muted">${t("activity.older", { n: rows.length - SHOWN })}</p>`}`;
}

// Activities, each with a link to what it is about.
export function ActivityList({ entries, topic }) {
  if (entries.length === 0) return html`<${Empty} topic=${topic}>${t("empty.activity")}<//>`;
  return html`<ol class="activity">${entries.map(({ key, row }) => {
    const address = row.conversation ? to("conversations", row.conversation) : row.agent ? to("agents", row.agent) : null;
    const sign = { routine: "info", notable: "well", problem: "bad" }[row.level] ?? "info";
    return html`<li key=${key} class="activity-${row.level}"><time datetime=${new Date(row.at).toISOString()}>${clock(row.at)}</time><${Sign} of=${sign} />
      <span>${row.level === "problem" && html`<span class="hidden-visually">${t("activity.problem")}: </span>`}${address ? html`<a href=${address}><${Told} of=${row.text} /></a>` : html`<${Told} of=${row.text} />`}</span></li>`;
  })}</ol>`;
}
