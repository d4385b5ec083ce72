// The overview: whether all is well, what needs a person, what is wanted, what happened last.

import { html } from "../lib/html.js";
import { t } from "../lib/language.js";
import { to, toSubject } from "../lib/router.js";
import { clock, number } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { ButtonLink, Card, Empty, PageHead, Sign, Text, Told } from "../lib/ui.js";
import { ActivityList } from "./activity.js";
import { GoalCards } from "./goals.js";
import { LastAnswer, QuestionCard } from "./questions.js";

const RECENT = 12;
const GOALS = 8;
const QUESTIONS = 3;

export function OverviewPage() {
  const overview = useTopic("overview");
  const goals = useTopic("goals");
  const activity = useTopic("activity");
  const questions = useTopic("questions");
  const inbox = useTopic("inbox");
  const found = overview.one;
  const open = goals.list.filter(({ row }) => row.ended_at === null || row.ended_at === undefined);
  return html`<${PageHead} title=${t("overview.title")}>
      <${ButtonLink} href="/ask" tone="primary">${t("nav.ask")}<//>
    <//>
    ${found ? html`<${Verdict} overview=${found} />` : html`<${Empty} topic=${overview} />`}
    ${found && html`<${Counts} counts=${found.counts} inbox=${inbox.list.length} />`}
    <${LastAnswer} questions=${questions.list} />
    <div class="columns">
      <div class="column">
        ${questions.list.length > 0 && html`<${Card} title=${t("overview.questions")} tone="bad"
          tools=${html`<a href="/questions">${t("overview.all")}</a>`}>
          <div class="cards">${questions.list.slice(0, QUESTIONS).map(({ key, row }) => html`<${QuestionCard} key=${key} row=${row} />`)}</div><//>`}
        <${Card} title=${t("overview.goals")} tools=${html`<a href="/goals">${t("overview.all")}</a>`}>
          <${GoalCards} rows=${open.slice(0, GOALS)} topic=${goals} />
          ${open.length > GOALS && html`<p><a href="/goals">${t("overview.more-goals", { n: open.length - GOALS })}</a></p>`}
        <//>
      </div>
      <div class="column">
        <${Card} title=${t("overview.recent")} tools=${html`<a href="/activity">${t("overview.all")}</a>`}>
          <${ActivityList} entries=${activity.list.slice(-RECENT).reverse()} topic=${activity} />
        <//>
      </div>
    </div>`;
}

function Verdict({ overview }) {
  return html`<section class="verdict verdict-${overview.verdict}" aria-label=${t("overview.verdict")}>
    <div class="verdict-head"><span class="verdict-sign" aria-hidden="true">${{ well: "✓", attention: "!", bad: "✗" }[overview.verdict]}</span>
      <p class="verdict-text"><span class="hidden-visually">${t(`verdict.${overview.verdict}`)}: </span><${Told} of=${overview.summary} /></p></div>
    ${overview.concerns.length > 0 && html`<ul class="concerns">${overview.concerns.map((concern, at) =>
      html`<li key=${at}><${Sign} of=${concern.level} /><span class="hidden-visually">${t(`verdict.${concern.level}`)}: </span>${linked(concern)}</li>`)}</ul>`}
    ${overview.more_concerns > 0 && html`<p class="muted">${t("overview.more-concerns", { n: overview.more_concerns })}</p>`}
  </section>`;
}

function linked(concern) {
  const address = toSubject(concern.subject);
  const text = html`<${Told} of=${concern.text} />`;
  return address ? html`<a href=${address}>${text}</a>` : text;
}

function Counts({ counts, inbox }) {
  const tiles = [
    ["agents", counts.agents, counts.agents_gone > 0 ? t("count.gone", { n: counts.agents_gone }) : t("count.present")],
    ["goals", counts.goals, t("count.goals", { running: counts.goals_running + counts.goals_planning, waiting: counts.goals_waiting, holding: counts.goals_holding })
      + (counts.goals_scheduled > 0 ? t("count.goals-scheduled", { n: counts.goals_scheduled }) : "")],
    ["questions", counts.questions, t("count.questions")],
    ["world", counts.facts, t("count.unknown", { n: counts.facts_unknown })],
    ["daemons", counts.daemons, t("count.messages", { n: number(counts.messages) })],
    ["inbox", inbox, t("count.inbox")],
  ];
  return html`<ul class="tiles" aria-label=${t("overview.counts")}>${tiles.map(([page, n, about]) => html`<li key=${page}>
    <a class="tile" href=${to(page)}><span class="tile-name">${t(`nav.${page}`)}</span><span class="tile-number">${number(n)}</span><span class="tile-about">${about}</span></a></li>`)}</ul>`;
}
