// The goal builder: what is to be true, of what, to be reached or kept. It shows the PDDL, and before
// the goal is asked for the plan, its cost, and what it would undo.

import { loadSetup, may, said, setup } from "../lib/api.js";
import { html, useEffect, useId, useRef, useState } from "../lib/html.js";
import { language, t } from "../lib/language.js";
import { duration, number } from "../lib/time.js";
import { SmallTable } from "../lib/table.js";
import { to } from "../lib/router.js";
import { useFollowed } from "../lib/state.js";
import { useTopic } from "../lib/topics.js";
import { Card, Outcome, PageHead, Text, useAct } from "../lib/ui.js";
import { line } from "../lib/visible.js";

const COMPARISONS = ["=", ">=", "<=", ">", "<"];

// Conditions of one goal that can be built here; more are typed as PDDL.
const CONDITIONS_MAX = 12;

// Times after which the daemon is asked what goals can be about, when the page is opened and when an
// agent comes or goes. The daemon finds that out when it is asked, and has it for the next time.
const ASKED_AFTER = [0, 2500, 5000];

// Time after the last change of a goal until its words are asked for, in milliseconds: a person types on.
const SAID_AFTER = 250;

export function AskPage() {
  const described = useFollowed(setup);
  const agents = useTopic("overview").one?.counts.agents;
  useEffect(() => {
    const timers = ASKED_AFTER.map((after) => setTimeout(loadSetup, after));
    return () => timers.forEach(clearTimeout);
  }, [agents]);
  return html`<${PageHead} title=${t("ask.title")} about=${t("ask.about")} />
    ${!may("ask") ? html`<p class="empty">${t("ask.no-right")}</p>`
      : described === null ? html`<p class="empty" role="status">${t("empty.loading")}</p>`
      : html`<${Builder} setup=${described} />`}`;
}

function Builder({ setup: described }) {
  const predicates = goalPredicates(described);
  const [chosen, setConditions] = useState(() => [fresh(predicates[0])]);
  // A condition of before the first predicate was known takes that; what is shown once stays chosen, so
  // that an object that comes or goes does not change the goal.
  const conditions = chosen.map((condition) => settled(condition, predicates, described));
  useEffect(() => {
    if (conditions.some((condition, at) => condition !== chosen[at])) setConditions(conditions);
  });
  const [typed, setTyped] = useState(null);
  const [mode, setMode] = useState("reach");
  const [within, setWithin] = useState("");
  const [tryIt, isTrying, tried, forgetTried] = useAct();
  const [ask, isAsking, asked, forgetAsked] = useAct();
  const result = useRef(null);
  const goalId = useId();
  const withinId = useId();
  const built = goalOf(conditions, described);
  const goal = typed ?? built ?? "";
  const isWhole = goal.trim() !== "";
  // An agent or a place that comes or goes may change the goal: what was tried is another one then.
  const shown = useRef(goal);
  useEffect(() => {
    if (shown.current === goal) return;
    shown.current = goal;
    forgetTried();
  }, [goal]);
  const changed = (next) => { next(); forgetTried(); forgetAsked(); };
  const replace = (at, condition) => changed(() => setConditions(conditions.map((old, n) => (n === at ? condition : old))));
  const minutes = Number(within);
  const dryRun = async () => {
    forgetAsked();
    await tryIt({ act: "dry-run", goal, mode });
    result.current?.focus();
  };
  const submit = (event) => {
    event.preventDefault();
    ask({ act: "goal", goal, mode, within_ms: mode === "reach" && minutes > 0 ? Math.round(minutes * 60000) : null });
  };
  return html`<form class="builder" onSubmit=${submit}>
    <${Card} title=${t("ask.what")}>
      ${typed === null ? html`
        ${predicates.length === 0 && html`<p class="empty">${t("ask.no-predicates")}</p>`}
        ${predicates.length > 0 && conditions.map((condition, at) => html`<${Condition} key=${at} condition=${condition} predicates=${predicates} setup=${described} number=${at + 1}
          onChange=${(next) => replace(at, next)} onRemove=${conditions.length > 1 ? () => changed(() => setConditions(conditions.filter((_, n) => n !== at))) : null} />`)}
        ${predicates.length > 0 && html`<button type="button" class="button" disabled=${conditions.length >= CONDITIONS_MAX} onClick=${() => changed(() => setConditions([...conditions, fresh(predicates[0])]))}>${t("ask.and")}</button>`}` : null}
      <div class="field pddl"><label for=${goalId}>${t("ask.pddl")}</label>
        <textarea id=${goalId} rows="3" spellcheck="false" readonly=${typed === null} value=${typed ?? line(goal)} onInput=${(event) => changed(() => setTyped(event.target.value))}></textarea></div>
      <${Said} of=${goal} />
      <button type="button" class="button" onClick=${() => changed(() => setTyped(typed === null ? goal : null))}>${typed === null ? t("ask.type") : t("ask.build")}</button>
    <//>
    <${Card} title=${t("ask.how")}>
      <fieldset class="choices"><legend class="hidden-visually">${t("ask.how")}</legend>
        ${["reach", "keep"].map((one) => html`<label key=${one} class="choice"><input type="radio" name="mode" value=${one} checked=${mode === one} onChange=${() => changed(() => setMode(one))} />
          <span><strong>${t(`ask.${one}`)}</strong><br /><span class="muted">${t(`ask.${one}-about`)}</span></span></label>`)}</fieldset>
      ${mode === "reach" && html`<div class="field"><label for=${withinId}>${t("ask.within")}</label>
        <input id=${withinId} type="number" min="0" step="any" inputmode="decimal" value=${within} onInput=${(event) => changed(() => setWithin(event.target.value))} /></div>`}
    <//>
    <p class="buttons"><button type="button" class="button" disabled=${!isWhole || isTrying} onClick=${dryRun}>${isTrying ? t("ask.trying") : t("ask.dry-run")}</button>
      <button class="button primary" disabled=${!isWhole || isAsking}>${t("ask.do")}</button></p>
    <div ref=${result} tabindex="-1" class="result">${tried && html`<${DryRun} outcome=${tried} />`}</div>
    <${Outcome} outcome=${asked} />
  </form>`;
}

// The goal in the words of the page's language; nothing if it has none.
function Said({ of }) {
  const [words, setWords] = useState("");
  useEffect(() => {
    let isOld = false;
    const timer = setTimeout(async () => {
      const found = await said([of], language).catch(() => []);
      if (!isOld) setWords(found[0] ?? "");
    }, SAID_AFTER);
    return () => {
      isOld = true;
      clearTimeout(timer);
    };
  }, [of, language]);
  if (words === "" || words === of.trim()) return null;
  return html`<p class="in-words"><span class="muted">${t("ask.words")}</span> <strong lang=${language}><${Text} of=${words} /></strong></p>`;
}

// What a goal would cause: shown before it is asked for.
function DryRun({ outcome }) {
  const found = outcome.detail;
  if (!outcome.ok && !found) return html`<${Outcome} outcome=${outcome} />`;
  const plan = found?.plan ?? [];
  const undoes = found?.undoes ?? [];
  const threatens = found?.threatens ?? [];
  return html`<${Card} title=${t("ask.result")} tone=${threatens.length > 0 || !outcome.ok ? "attention" : ""}>
    <p role="status"><strong><${Text} of=${outcome.sentence} /></strong></p>
    ${found?.already && html`<p>${t("ask.already")}</p>`}
    ${found?.problem && found.problem !== outcome.sentence && html`<p class="problem"><${Text} of=${found.problem} /></p>`}
    ${typeof found?.cost === "number" && plan.length > 0 && html`<p>${t("ask.cost", { cost: number(found.cost), n: plan.length })}</p>`}
    ${plan.length > 0 && html`<${SmallTable} label=${t("ask.plan")} head=${[t("plan.step"), t("agent.agent"), t("plan.start"), t("plan.time")]}
      rows=${plan.map((step) => [html`<code><${Text} of=${step.step} /></code>`, html`<${Text} of=${step.agent} />`, timeOf(step.start), timeOf(step.duration)])} />`}
    ${threatens.length > 0 && html`<h3>${t("ask.threatens")}</h3><ul class="problems">${threatens.map((one, at) => html`<li key=${at}><code><${Text} of=${one.conjunct} /></code>, ${t("ask.wanted-by")} <a href=${to("goals", one.conversation)}><code><${Text} of=${one.goal} /></code></a></li>`)}</ul>`}
    ${undoes.length > 0 ? html`<h3>${t("ask.undoes")}</h3><ul class="warnings">${undoes.map((fact, at) => html`<li key=${at}><code><${Text} of=${fact} /></code></li>`)}</ul>`
      : plan.length > 0 && html`<p class="muted">${t("ask.undoes-nothing")}</p>`}
  <//>`;
}

// A time of a plan, in milliseconds; unknown if no run of the step was seen.
function timeOf(value) {
  if (typeof value !== "number") return "";
  return value === 0 ? duration(0) : `~${duration(value)}`;
}

function Condition({ condition, predicates, setup: described, number: at, onChange, onRemove }) {
  const found = predicates.find((one) => one.name === condition.name);
  // What no agent can change any more stays chosen, and is no goal: another one must not take its place.
  const predicate = found ?? { name: condition.name, parameters: [], is_function: false };
  const { values } = condition;
  const id = useId();
  const pick = (position, value) => onChange({ ...condition, values: values.map((old, n) => (n === position ? value : old)) });
  return html`<fieldset class="condition"><legend>${t("ask.condition", { n: at })}</legend><div class="builder-row">
    ${predicate.is_function ? null : html`<div class="field"><label for=${`${id}n`}>${t("ask.truth")}</label><select id=${`${id}n`} value=${condition.isNot ? "not" : "is"} onChange=${(event) => onChange({ ...condition, isNot: event.target.value === "not" })}>
      <option value="is">${t("ask.is")}</option><option value="not">${t("ask.not")}</option></select></div>`}
    <div class="field"><label for=${`${id}p`}>${t("ask.predicate")}</label><select id=${`${id}p`} value=${predicate.name} onChange=${(event) => onChange({ ...fresh(predicates.find((one) => one.name === event.target.value)), isNot: condition.isNot })}>
      ${!found && html`<option value=${condition.name}>${line(condition.name)}</option>`}
      ${predicates.map((one) => html`<option key=${one.name} value=${one.name}>${line(one.name)}</option>`)}</select></div>
    <${PickArguments} parameters=${predicate.parameters} values=${values} setup=${described} onPick=${pick} />
    ${predicate.is_function && html`<div class="field"><label for=${`${id}c`}>${t("ask.comparison")}</label><select id=${`${id}c`} value=${condition.comparison} onChange=${(event) => onChange({ ...condition, comparison: event.target.value })}>
      ${COMPARISONS.map((one) => html`<option key=${one} value=${one}>${one}</option>`)}</select></div>
      <div class="field"><label for=${`${id}v`}>${t("ask.value")}</label><input id=${`${id}v`} type="number" step="any" value=${condition.number} onInput=${(event) => onChange({ ...condition, number: event.target.value })} /></div>`}
    ${onRemove && html`<button type="button" class="button" onClick=${onRemove}>${t("ask.remove")}</button>`}
  </div></fieldset>`;
}

// Fields for the arguments of a predicate or an action: each offers the objects of its type. One that was
// chosen and is gone stays chosen, and is said to be gone.
export function PickArguments({ parameters, values, setup: described, onPick }) {
  const id = useId();
  return parameters.map((parameter, at) => {
    const objects = objectsOf(parameter.types, described);
    const gone = isGone(parameter, values[at], described) ? values[at] : null;
    return html`<div class="field" key=${`${at}${parameter.name}`}><label for=${`${id}${at}`}>${line(parameter.name)}${parameter.types.length > 0 && html` <span class="muted">(${line(parameter.types.join(", "))})</span>`}</label>
      <select id=${`${id}${at}`} value=${values[at]} onChange=${(event) => onPick(at, event.target.value)}>
        ${objects.length === 0 && gone === null && html`<option value="">${t("ask.no-object")}</option>`}
        ${gone !== null && html`<option value=${gone}>${t("ask.gone", { name: line(gone) })}</option>`}
        ${objects.map((name) => html`<option key=${name} value=${name}>${line(name)}</option>`)}</select></div>`;
  });
}

// The arguments as picked, also those that are gone; where none is picked, the first object that fits.
export function argumentsOf(parameters, picked, described) {
  return parameters.map((parameter, at) => picked[at] || (objectsOf(parameter.types, described)[0] ?? ""));
}

// Whether an argument was chosen that is no object of its type, or none any more.
function isGone(parameter, value, described) {
  return Boolean(value) && !objectsOf(parameter.types, described).includes(value);
}

// Whether each argument is there.
export function areWhole(parameters, values, described) {
  return parameters.every((parameter, at) => Boolean(values[at]) && !isGone(parameter, values[at], described));
}

// The condition with what is shown where nothing is chosen; the same one if all is chosen.
function settled(condition, predicates, described) {
  if (condition.name === "" && predicates.length === 0) return condition;
  const known = condition.name === "" ? fresh(predicates[0]) : condition;
  const parameters = predicates.find((one) => one.name === known.name)?.parameters ?? [];
  const values = argumentsOf(parameters, known.values, described);
  return values.every((value, at) => value === (known.values[at] ?? "")) ? known : { ...known, values };
}

// The objects of one of the types, or of a kind of them.
function objectsOf(types, described) {
  const parents = new Map((described?.types ?? []).map((type) => [type.name, type.parent]));
  const isOf = (kind) => {
    // A circle of types, which no domain has, must not hang the page.
    for (let type = kind, depth = 0; type && depth < 64; type = parents.get(type), depth += 1) {
      if (types.includes(type)) return true;
    }
    return types.length === 0 || types.includes("object");
  };
  return (described?.objects ?? []).filter((object) => isOf(object.type)).map((object) => object.name).sort();
}

// What a goal can be about: what some action changes, first by name.
function goalPredicates(described) {
  const able = described.predicates.filter((predicate) => predicate.can_change);
  return (able.length > 0 ? able : described.predicates).slice().sort((one, other) => (one.name < other.name ? -1 : 1));
}

function fresh(predicate) {
  return { name: predicate?.name ?? "", values: [], isNot: false, comparison: "=", number: "0" };
}

// The goal as PDDL; `null` while a part of it is missing.
function goalOf(conditions, described) {
  const parts = conditions.map((condition) => {
    const predicate = goalPredicates(described).find((one) => one.name === condition.name);
    if (!predicate) return null;
    const { values } = condition;
    if (!areWhole(predicate.parameters, values, described)) return null;
    const atom = `(${[predicate.name, ...values].join(" ")})`;
    if (predicate.is_function) {
      const value = Number(condition.number);
      return condition.number === "" || !Number.isFinite(value) ? null : `(${condition.comparison} ${atom} ${value})`;
    }
    return condition.isNot ? `(not ${atom})` : atom;
  });
  if (parts.length === 0 || parts.includes(null)) return null;
  return parts.length === 1 ? parts[0] : `(and ${parts.join(" ")})`;
}
