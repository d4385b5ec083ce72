// Open questions as cards with a deadline. The answer to a secret question is typed hidden, and is
// kept nowhere in the page after it is sent.

import { mayAnswer } from "../lib/api.js";
import { html, useEffect, useId, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { Followed, useFollowed } from "../lib/state.js";
import { age, useNow } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { Empty, Link, Outcome, PageHead, Text, useAct } from "../lib/ui.js";

// Time left under which a question is urgent.
const URGENT = 30000;

// How the last answer that was sent here has ended: `null`, or `{ id, text, outcome }` with the question.
const answered = new Followed(null);

// Says how the last answer has ended once its card is gone. So one who was too late is told that.
export function LastAnswer({ questions }) {
  const last = useFollowed(answered);
  useEffect(() => { answered.set(null); return () => answered.set(null); }, []);
  const isGone = last !== null && !questions.some(({ row }) => row.id === last.id);
  return html`<div class="last-answer"><${Outcome} outcome=${isGone ? last.outcome : null}><p class="muted small"><${Text} of=${last?.text ?? ""} /></p><//></div>`;
}

export function QuestionsPage() {
  const topic = useTopic("questions");
  return html`<${PageHead} title=${t("nav.questions")} about=${t("questions.about")} />
    <${LastAnswer} questions=${topic.list} />
    <div class="cards">${topic.list.map(({ key, row }) => html`<${QuestionCard} key=${key} row=${row} />`)}</div>
    ${topic.list.length === 0 && html`<${Empty} topic=${topic}>${t("empty.questions")}<//>`}`;
}

// One question, with what answers it.
export function QuestionCard({ row, isLarge }) {
  const [run, isBusy, outcome] = useAct();
  const [text, setText] = useState("");
  const id = useId();
  const place = answerable(row);
  const send = async (answer) => {
    const done = await run({ act: "answer", keyboard: place.keyboard, question: place.number, text: answer });
    if (done.ok || row.is_secret) setText("");
    answered.set({ id: row.id, text: row.text, outcome: done });
  };
  const submit = (event) => { event.preventDefault(); if (text !== "") send(text); };
  return html`<article class="question ${isLarge ? "question-large" : ""}" aria-labelledby=${`${id}q`}>
    <p class="question-text" id=${`${id}q`}><${Text} of=${row.text} /></p>
    <p class="muted small">${t("question.from")} <${Link} page="agents" name=${row.from} /> <${Left} row=${row} /></p>
    ${!mayAnswer(row.from) ? html`<p class="muted">${t("question.no-right")}</p>` : place === null ? html`<p class="muted">${t("question.no-number")}</p>` : html`
    <form onSubmit=${submit} class="answer">
      <label for=${id}>${row.is_secret ? t("question.secret-answer") : t("question.answer")}</label>
      <input id=${id} type=${row.is_secret ? "password" : "text"} value=${text} autocomplete="off" autocapitalize="none" spellcheck="false" inputmode=${row.is_secret ? "numeric" : "text"} onInput=${(event) => setText(event.target.value)} />
      <button class="button primary" disabled=${isBusy || text === ""}>${t("question.send")}</button>
      ${!row.is_secret && html`<button type="button" class="button" disabled=${isBusy} onClick=${() => send("yes")}>${t("question.yes")}</button>
        <button type="button" class="button" disabled=${isBusy} onClick=${() => send("no")}>${t("question.no")}</button>`}
      ${row.is_secret && isLarge && html`<${PinPad} onDigit=${(digit) => setText((before) => before + digit)} onBack=${() => setText((before) => before.slice(0, -1))} />`}
    </form>`}
    <${Outcome} outcome=${outcome} /></article>`;
}

// Where an answer goes: the Keyboard Agent and the number of the question.
function answerable(row) {
  const at = row.id?.lastIndexOf("/") ?? -1;
  if (at < 0) return null;
  const number = Number(row.id.slice(at + 1));
  return Number.isSafeInteger(number) ? { keyboard: row.id.slice(0, at), number } : null;
}

function Left({ row }) {
  const present = useNow();
  const until = row.ends_at;
  if (until === null || until === undefined) return null;
  const left = until - present;
  return html`<span class=${left < URGENT ? "urgent" : ""} role="timer" aria-live="off">· ${left > 0 ? t("question.left", { time: age(left) }) : t("question.over")}</span>`;
}

// Large buttons for digits, for a screen without a keyboard.
function PinPad({ onDigit, onBack }) {
  return html`<div class="pin-pad" role="group" aria-label=${t("question.pin-pad")}>
    ${["1", "2", "3", "4", "5", "6", "7", "8", "9"].map((digit) => html`<button type="button" key=${digit} class="button" onClick=${() => onDigit(digit)}>${digit}</button>`)}
    <button type="button" class="button" aria-label=${t("question.back")} onClick=${onBack}>⌫</button>
    <button type="button" class="button" onClick=${() => onDigit("0")}>0</button></div>`;
}
