// Discovered agents that no file names: each takes part after a person's consent.

import { may } from "../lib/api.js";
import { html } from "../lib/html.js";
import { t } from "../lib/language.js";
import { useTopic } from "../lib/topics.js";
import { Code, Empty, Link, Outcome, PageHead, Text, useAct } from "../lib/ui.js";

export function InboxPage() {
  const topic = useTopic("inbox");
  return html`<${PageHead} title=${t("nav.inbox")} about=${t("inbox.about")} />
    <div class="cards cards-wide">${topic.list.map(({ key, row }) => html`<${Discovered} key=${key} row=${row} />`)}</div>
    ${topic.list.length === 0 && html`<${Empty} topic=${topic}>${t("empty.inbox")}<//>`}`;
}

function Discovered({ row }) {
  const [run, isBusy, outcome] = useAct();
  const found = row.discovered ?? row;
  const agent = found.agent ?? row.agent;
  return html`<article class="card"><div class="card-head"><h2><${Link} page="agents" name=${agent} /></h2><span class="muted">${t("inbox.by")} <${Text} of=${found.by} /></span></div>
    ${found.problem && html`<p class="problem"><${Text} of=${found.problem} /></p>`}
    <p>${found.joined ? t("inbox.joined") : t("inbox.waits")}</p>
    ${may("admit") ? html`<p class="buttons"><button type="button" class="button primary" disabled=${isBusy || found.joined} onClick=${() => run({ act: "admit", agent, allow: true })}>${t("inbox.admit")}</button>
      <button type="button" class="button" disabled=${isBusy} onClick=${() => run({ act: "admit", agent, allow: false })}>${t("inbox.forbid")}</button></p>` : html`<p class="muted">${t("inbox.no-right")}</p>`}
    <${Outcome} outcome=${outcome} />
    ${found.toml && html`<details><summary>${t("inbox.toml")}</summary><${Code} of=${found.toml} label=${t("inbox.toml")} /></details>`}</article>`;
}
