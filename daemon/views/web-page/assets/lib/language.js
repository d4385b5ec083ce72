// The languages of the page: message catalogues, one JSON file each, with the same keys.
// Sentences that come from the ecosystem (why a goal waits, what happened) are shown as they are.

import { recall, remember } from "./keeping.js";

// The languages there are, each by its own name. A new one is a file in `messages/` and a line here.
export const LANGUAGES = { en: "English", de: "Deutsch" };

const CHOICE = "language";
let messages = {};
let plurals = new Intl.PluralRules("en");
export let language = "en";

// Loads the chosen language, or the first of the browser's that there is.
export async function loadLanguage() {
  const chosen = [recall(CHOICE), ...navigator.languages.map((tag) => tag.slice(0, 2)), "en"];
  await use(chosen.find((tag) => tag in LANGUAGES));
}

// Changes the language and remembers the choice in this browser.
export async function chooseLanguage(tag) {
  remember(CHOICE, tag);
  await use(tag);
}

async function use(tag) {
  const answer = await fetch(`/assets/messages/${tag}.json`);
  if (!answer.ok) throw new Error(`the messages of the language ${tag} are missing`);
  messages = await answer.json();
  plurals = new Intl.PluralRules(tag);
  language = tag;
  document.documentElement.lang = tag;
}

// Returns the message of a key. `{name}` stands for a value; with `n` given, `KEY.one` and
// `KEY.other` are its forms. A key without a message is shown itself, so that nobody overlooks it.
export function t(key, values = {}) {
  let message = messages[key];
  if (message === undefined && "n" in values) {
    message = messages[`${key}.${plurals.select(values.n)}`] ?? messages[`${key}.other`];
  }
  if (message === undefined) return key;
  return message.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? String(values[name]) : whole));
}

// Returns the message of a key, or a fallback if there is none: for words that a newer daemon knows.
export function tOr(key, fallback) {
  return messages[key] ?? fallback;
}
