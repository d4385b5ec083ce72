// The screen on board of a robot: large and for fingers. What it does, where it goes, and its
// question with a pad for digits. It is shown to people that have signed in, and by the browser of the
// robot itself, which is its screen and sees nothing else.

import { me } from "../lib/api.js";
import { html } from "../lib/html.js";
import { t } from "../lib/language.js";
import { useFollowed } from "../lib/state.js";
import { Since } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { Link, PageHead, SignOut, State, Text } from "../lib/ui.js";
import { agentState } from "./agents.js";
import { LastAnswer, QuestionCard } from "./questions.js";

export function RobotPage({ name }) {
  const person = useFollowed(me);
  const topic = useTopic(`robot:${name}`);
  const row = topic.rows.get("agent");
  const robot = topic.rows.get("place");
  const own = topic.list.filter(({ key }) => key.startsWith("question/"));
  return html`<div class="robot-page"><${PageHead} title=${html`<${Text} of=${name} />`} />
    ${!row ? html`<p class="robot-now">${topic.isLoaded ? t("empty.agent") : t("empty.loading")}</p>` : html`
      <p class="robot-now"><span role="status"><${State} of=${agentState(row)} /> ${row.doing ? html`<${Text} of=${row.doing} />` : t("robot.idle")}</span>
        ${row.doing_since && html` <span class="muted">· <${Since} at=${row.doing_since} /></span>`}</p>
      ${robot && html`<p class="robot-place">${robot.room ? html`${t("robot.in")} <strong><${Text} of=${robot.room} /></strong>` : t("robot.unknown")}${robot.path.length > 0 && html` → <${Text} of=${robot.path.join(" → ")} />`}</p>`}`}
    <${LastAnswer} questions=${own} />
    <div class="cards robot-questions" aria-live="polite">${own.map((one) => html`<${QuestionCard} key=${one.key} row=${one.row} isLarge=${true} />`)}</div>
    ${row && own.length === 0 && html`<p class="muted">${t("robot.no-question")}</p>`}
    ${person && !person.screen && html`<p class="muted robot-foot"><${Link} page="agents" name=${name}>${t("robot.more")}<//>
      <${SignOut} label=${t("robot.sign-out", { person: person.person })} /></p>`}</div>`;
}
