// One agent: what it does, what it offers, its facts, its replicas; and the form that asks for one
// of its actions.

import { may, setup } from "../lib/api.js";
import { html, useEffect, useId, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { At, Late, Since, duration } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { SmallTable } from "../lib/table.js";
import { useFollowed } from "../lib/state.js";
import { AskTwice, Card, Code, Empty, Facts, Link, Outcome, PageHead, State, Text, Told, useAct } from "../lib/ui.js";
import { line } from "../lib/visible.js";
import { areWhole, argumentsOf, PickArguments } from "./ask.js";
import { ActivityList } from "./activity.js";
import { agentState } from "./agents.js";
import { SaidFact } from "../lib/words.js";

export function AgentPage({ name }) {
  const topic = useTopic(`agent:${name}`);
  const [run, isBusy, outcome] = useAct();
  const detail = topic.one;
  if (!detail) return html`<${PageHead} title=${html`<${Text} of=${name} />`} about=${t("agent.title")} /><${Empty} topic=${topic}>${t("empty.agent")}<//>`;
  const row = detail.row;
  return html`<${PageHead} title=${html`<${Text} of=${row.agent} />`} about=${t("agent.title")}>
      <a class="button" href=${`/robot/${encodeURIComponent(row.agent)}`}>${t("agent.screen")}</a>
      <${AskTwice} label=${t("agent.stop")} sure=${t("agent.stop-sure")} disabled=${isBusy}
        onDo=${() => run({ act: "stop", names: [row.agent], because: t("stop.because-page") })} />
    <//>
    <${Outcome} outcome=${outcome} />
    <div class="lead"><${State} of=${agentState(row)} /> ${row.doing ? html`<${Text} of=${row.doing} />` : t("agent.idle")}
      ${row.doing_since && html` <span class="muted">· <${Since} at=${row.doing_since} /></span>`}
      <${Late} row=${row} /></div>
    ${row.problems.length > 0 && html`<ul class="problems">${row.problems.map((problem, at) => html`<li key=${at}><${Told} of=${problem} /></li>`)}</ul>`}
    <${Facts} rows=${[
      [t("agent.daemon"), row.daemon && html`<a href="/daemons"><${Text} of=${row.daemon} /></a>`],
      [t("agent.since"), row.since && html`<${Since} at=${row.since} />`],
      [t("agent.beat"), row.heartbeat_at && html`<${Since} at=${row.heartbeat_at} />`],
      [t("agent.mail"), detail.mailbox && t("agent.mail-counts", { waiting: detail.mailbox.waiting, max: detail.mailbox.waiting_max, received: detail.mailbox.received })],
    ]} />
    <${Camera} row=${row} />
    ${detail.running.length > 0 && html`<${Card} title=${t("agent.running")}><ul class="plain">${detail.running.map((step, at) => html`<li key=${at}>
      <${State} of=${step.state} /> ${step.conversation ? html`<${Link} page="goals" name=${step.conversation}><span title=${line(step.step)}><${Text} of=${step.text} /></span><//>` : html`<span title=${line(step.step)}><${Text} of=${step.text} /></span>`} <span class="muted"><${Text} of=${step.detail} /></span></li>`)}</ul><//>`}
    ${may("ask") && html`<${Act} agent=${row.agent} />`}
    <${Card} title=${t("agent.actions")}><${SmallTable} label=${t("agent.actions")} head=${[t("agent.action"), t("agent.offered"), t("agent.runs"), t("agent.usual")]}
      rows=${detail.actions.map((action) => [
        html`<code><${Text} of=${`${action.action} ${action.parameters}`} /></code>`,
        action.is_offered ? t("word.yes") : t("agent.withdrawn"),
        action.failures > 0 ? t("agent.runs-failed", { runs: action.runs, failures: action.failures }) : action.runs,
        duration(action.usual_ms)])} /><//>
    <${Card} title=${t("agent.facts")}><${SmallTable} label=${t("agent.facts")} head=${[t("fact.fact"), t("fact.truth"), t("fact.freshness")]}
      rows=${detail.facts.map((fact) => [html`<${SaidFact} row=${fact} />`, html`<${State} of=${fact.truth} />`, html`<${State} of=${fact.freshness} />`])} /><//>
    ${detail.replicas.length > 1 && html`<${Card} title=${t("agent.replicas")}><${SmallTable} label=${t("agent.replicas")} head=${[t("agent.daemon"), t("agent.leads"), t("agent.since")]}
      rows=${detail.replicas.map((replica) => [html`<${Text} of=${replica.daemon} />`, replica.leads === null ? t("state.unknown") : html`<${State} of=${replica.leads ? "leads" : "standby"} />`, html`<${At} at=${replica.since} />`])} /><//>`}
    <${Card} title=${t("agent.recent")}><${ActivityList} entries=${detail.recent.map((entry) => ({ key: entry.number, row: entry })).reverse()} /><//>
    ${detail.model && html`<${Card} title=${t("agent.model")}><details><summary>${t("agent.model-show")}</summary><${Code} of=${detail.model} label=${t("agent.model")} /></details><//>`}`;
}

// The newest picture of a camera, for agents that take pictures.
function Camera({ row }) {
  const [asked, setAsked] = useState(0);
  const [isMissing, setMissing] = useState(false);
  const isCamera = row.actions.some((action) => /picture|snapshot|look|camera|video/.test(action));
  if (!isCamera) return null;
  return html`<${Card} title=${t("camera.title")} tools=${html`<button type="button" class="button" onClick=${() => { setMissing(false); setAsked(Date.now()); }}>${t("camera.show")}</button>`}>
    ${asked > 0 && !isMissing && html`<img class="camera" alt=${t("camera.alt", { agent: "" })} src=${`/api/cameras/${encodeURIComponent(row.agent)}?at=${asked}`} onError=${() => setMissing(true)} />`}
    <p role="status" class="muted">${isMissing ? t("camera.missing") : asked ? "" : t("camera.about")}</p><//>`;
}

// Asks the agent for one of its actions, with arguments that fit.
function Act({ agent }) {
  const described = useFollowed(setup);
  const [run, isBusy, outcome] = useAct();
  const [name, setName] = useState("");
  const [picked, setPicked] = useState([]);
  const id = useId();
  const offered = (described?.actions ?? []).filter((action) => action.agent === agent);
  // An action that was chosen and is offered no more stays chosen: another one must not take its place.
  const found = offered.find((one) => one.name === (name || offered[0]?.name));
  const action = found ?? { name, parameters: [] };
  const values = argumentsOf(action.parameters, picked, described);
  const isWhole = found !== undefined && areWhole(action.parameters, values, described);
  // What is shown stays chosen: an object that comes or goes does not change what is asked for.
  const isSettled = name === action.name && values.every((value, at) => value === (picked[at] ?? ""));
  useEffect(() => {
    if (!found || isSettled) return;
    setName(action.name);
    setPicked(values);
  });
  if (offered.length === 0) return null;
  const step = `(${[action.name, agent, ...values].join(" ")})`;
  return html`<${Card} title=${t("action.title")}><form onSubmit=${(event) => { event.preventDefault(); run({ act: "action", agent, action: step }); }}>
    <div class="builder-row"><div class="field"><label for=${id}>${t("agent.action")}</label><select id=${id} value=${action.name} onChange=${(event) => { setName(event.target.value); setPicked([]); }}>
      ${!found && html`<option value=${name}>${t("ask.gone", { name: line(name) })}</option>`}
      ${offered.map((one) => html`<option key=${one.name} value=${one.name}>${one.name}</option>`)}</select></div>
      <${PickArguments} parameters=${action.parameters} values=${values} setup=${described} onPick=${(at, value) => setPicked(values.map((old, n) => (n === at ? value : old)))} /></div>
    <p><code>${step}</code></p>
    <button class="button primary" disabled=${isBusy || !isWhole}>${t("action.ask")}</button><${Outcome} outcome=${outcome} /></form><//>`;
}
