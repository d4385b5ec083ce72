// Goals and facts in the words of the page's language, as the daemon says them; a person may choose
// PDDL instead. What has no words, or not yet, is shown in PDDL.

import { may, said } from "./api.js";
import { html, useEffect, useState } from "./html.js";
import { recall, remember } from "./keeping.js";
import { language } from "./language.js";
import { Followed, useFollowed } from "./state.js";
import { number } from "./time.js";
import { line } from "./visible.js";

const CHOICE = "words";

// How goals and facts are shown: "words" or "pddl".
export const shownAs = new Followed(recall(CHOICE) === "pddl" ? "pddl" : "words");

// Chooses how goals and facts are shown, and remembers the choice in this browser.
export function showAs(choice) {
  remember(CHOICE, choice);
  shownAs.set(choice);
}

// Texts of one request: the daemon takes 32 parameters, and an address has its limits.
const TEXTS_MAX = 24;
const LENGTH_MAX = 3000;

// Time for which texts are gathered before they are asked for, in milliseconds: a page draws many at
// once.
const GATHERED_FOR = 40;

// Time after which a failed request is made again, in milliseconds.
const TRY_AGAIN = 10000;

// Texts whose words are remembered. Of more, those that were asked for first are forgotten.
const KEPT_MAX = 5000;

// The words that are known, by language and text, and the number of answers so far.
const known = new Map();
const answers = new Followed(0);
const wanted = new Set();
let gathering = null;

function keyOf(pddl) {
  return `${language} ${pddl}`;
}

// Returns the words of a goal or a fact if they are known, or else its PDDL.
export function wordsOf(pddl) {
  return known.get(keyOf(pddl)) ?? pddl;
}

function want(pddl) {
  if (!pddl.startsWith("(") || pddl.length > LENGTH_MAX || known.has(keyOf(pddl)) || !may("look")) return;
  wanted.add(pddl);
  gathering ??= setTimeout(ask, GATHERED_FOR);
}

// Asks for the words of what is wanted, one request after the other.
async function ask() {
  const tag = language;
  const texts = [];
  let length = 0;
  for (const pddl of wanted) {
    const size = encodeURIComponent(pddl).length;
    if (texts.length >= TEXTS_MAX || (texts.length > 0 && length + size > LENGTH_MAX)) break;
    texts.push(pddl);
    length += size;
  }
  texts.forEach((pddl) => wanted.delete(pddl));
  try {
    const words = await said(texts, tag);
    texts.forEach((pddl, at) => known.set(`${tag} ${pddl}`, words[at] ?? pddl));
    for (const oldest of known.keys()) {
      if (known.size <= KEPT_MAX) break;
      known.delete(oldest);
    }
    answers.set(answers.value + 1);
    gathering = wanted.size > 0 ? setTimeout(ask, 0) : null;
  } catch {
    texts.forEach((pddl) => wanted.add(pddl));
    gathering = setTimeout(ask, TRY_AGAIN);
  }
}

// Draws a goal or a fact that is given in PDDL, with the PDDL behind its words.
export function Said({ of }) {
  return html`<${SaidAs} of=${of} pddl=${of} turn=${(words) => words} />`;
}

// A number that stands for the value of a function while its words are asked for: they are the same for
// every value.
const ANY_VALUE = "987654321";

// Draws a fact: that a function has a value, or that a predicate is true, false or unknown.
export function SaidFact({ row }) {
  if (row.value === null || row.value === undefined) return html`<${Said} of=${row.fact} />`;
  const about = [row.predicate, ...row.arguments].join(" ");
  const value = number(row.value, 4);
  const asked = `(= (${about}) ${ANY_VALUE})`;
  const turn = (words) => (words === asked || !words.includes(ANY_VALUE) ? `${about} = ${value}` : words.replace(ANY_VALUE, value));
  return html`<${SaidAs} of=${asked} pddl=${row.fact} turn=${turn} />`;
}

function SaidAs({ of, pddl, turn }) {
  const choice = useFollowed(shownAs);
  const [, again] = useState(0);
  useEffect(() => {
    if (choice !== "words" || known.has(keyOf(of))) return undefined;
    want(of);
    return answers.follow(() => { if (known.has(keyOf(of))) again((n) => n + 1); });
  }, [of, choice, language]);
  const words = turn(wordsOf(of));
  if (choice !== "words" || words === pddl) return html`<code><bdi>${line(choice === "words" ? words : pddl)}</bdi></code>`;
  return html`<bdi title=${line(pddl)}>${line(words)}</bdi>`;
}
