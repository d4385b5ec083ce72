// Fixed sentences of the ecosystem in the language of the page. The daemon says them in English, with
// names, goals and times in them; those that are not known here are shown as they are.

import { language, t } from "./language.js";
import { line } from "./visible.js";

// The sentences: the key of the message, and what the daemon says. Groups with a name are the values.
const SENTENCES = [
  ["well", /^all is well: (?<parts>.+)$/],
  ["attention", /^(?<n>\d+) things? needs? attention$/],
  ["wrong", /^(?<n>\d+) things? (?:is|are) wrong$/],
  ["wrong-and-attention", /^(?<wrong>\d+) things? (?:is|are) wrong, and (?<n>\d+) things? needs? attention$/],
  ["not-reached-before", /^the ecosystem is not reached; this is how it was before$/],
  ["not-reached", /^the ecosystem is not reached$/],
  ["reached-again", /^the ecosystem is reached again$/],
  ["agent-gone-for", /^(?<agent>\S+) has been gone for (?<time>.+)$/],
  ["agent-silent-for", /^(?<agent>\S+) has sent no heartbeat for (?<time>.+)$/],
  ["agent-absent", /^(?<agent>\S+) is named in the ecosystem file, and is not here$/],
  ["gone-for", /^gone for (?<time>.+)$/],
  ["silent-for", /^no heartbeat for (?<time>.+)$/],
  ["absent", /^the ecosystem file names it, and it is not here$/],
  ["all-stopped-because", /^everything is stopped by (?<by>[^\s:]+): (?<why>.+)$/],
  ["all-stopped", /^everything is stopped by (?<by>[^\s:]+)$/],
  ["stopped-because", /^(?<what>.+) (?:is|are) stopped by (?<by>[^\s:]+): (?<why>.+)$/],
  ["stopped", /^(?<what>.+) (?:is|are) stopped by (?<by>[^\s:]+)$/],
  ["button-pressed", /^the hardware stop (?<button>\S+) is pressed$/],
  ["button-silent", /^the hardware stop (?<button>\S+) does not report its position$/],
  ["daemon-gone", /^the daemon (?<daemon>\S+) is gone$/],
  ["daemon-silent", /^the daemon (?<daemon>\S+) does not answer$/],
  ["daemon-restarted", /^the daemon (?<daemon>\S+) was restarted$/],
  ["it-is-gone", /^it is gone$/],
  ["it-is-silent", /^it does not answer$/],
  ["certificate-ended", /^its certificate ends today, or has ended$/],
  ["certificate-ends", /^its certificate ends in (?<n>\d+) days?$/],
  ["unread", /^(?<n>\d+) messages? could not be read$/],
  ["not-observed", /^(?<n>\d+) messages? not observed$/],
  ["agent-here", /^(?<agent>\S+) is here$/],
  ["agent-gone", /^(?<agent>\S+) is gone$/],
  ["offers-nothing", /^(?<agent>\S+) offers nothing now$/],
  ["offers", /^(?<agent>\S+) offers (?<actions>.+)$/],
  ["asks-to-keep", /^(?<agent>\S+) asks for (?<goal>\(.+\)), and to keep it$/],
  ["asks-for", /^(?<agent>\S+) asks for (?<goal>\(.+\))$/],
  ["asks-people", /^(?<agent>\S+) asks people: (?<question>.+)$/],
  ["asks", /^(?<agent>\S+) asks: (?<question>.+)$/],
  ["answered", /^(?<agent>\S+) has an answer of a person$/],
  ["cancels", /^(?<agent>\S+) cancels (?<goal>\(.+\))$/],
  ["calls", /^(?<agent>\S+) calls for proposals for (?<goal>.+)$/],
  ["chosen", /^(?<agent>\S+) is chosen for (?<goal>.+)$/],
  ["holds", /^(?<goal>\(.+\)) holds, and is watched$/],
  ["reached", /^(?<goal>\(.+\)) is reached$/],
  ["failed-because", /^(?<goal>\(.+\)) has failed: (?<why>.+)$/],
  ["cancelled-because", /^(?<goal>\(.+\)) is cancelled: (?<why>.+)$/],
  ["refused-because", /^(?<goal>\(.+\)) is refused: (?<why>.+)$/],
  ["waits-because", /^(?<goal>\(.+\)) is waiting: (?<why>.+)$/],
  ["failed", /^failed: (?<why>.+)$/],
  ["waiting", /^waiting: (?<why>.+)$/],
  ["executing", /^executing: (?<done>\d+) of (?<n>\d+) steps done$/],
  ["late", /^(?<what>.+): (?<time>\d\S* \w+) longer than usual$/],
];

// The parts of the sentence that all is well.
const PARTS = [
  ["no-goals", /^no goals$/],
  ["goals-hold", /^(?<n>\d+) goals? holds?$/],
  ["goals-wait", /^(?<n>\d+) goals? waits?$/],
  ["goals-planned", /^(?<n>\d+) goals? being planned for$/],
  ["goals-executed", /^(?<n>\d+) goals? being executed$/],
  ["goals-scheduled", /^(?<n>\d+) goals? by the clock$/],
  ["agents-here", /^(?<n>\d+) agents? here$/],
];

// Returns a sentence of the ecosystem in the language of the page, as one line that hides nothing.
export function told(text) {
  const said = line(text);
  return language === "en" ? said : translated(SENTENCES, said);
}

function translated(sentences, said) {
  for (const [key, pattern] of sentences) {
    const found = pattern.exec(said);
    if (found === null) continue;
    const values = { ...found.groups };
    if (values.n !== undefined) values.n = Number(values.n);
    if (values.time !== undefined) values.time = values.time.replace(/ days?$/, ` ${t("told.days")}`);
    if (values.parts !== undefined) values.parts = values.parts.split(", ").map((part) => translated(PARTS, part)).join(", ");
    return t(`told.${key}`, values);
  }
  return said;
}
