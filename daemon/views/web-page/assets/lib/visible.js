// Makes control characters and misleading characters in texts from outside visible, by the rule of
// the terminal (`daemon/command-line/terminal/src/visible.rs`). Preact writes texts as texts, never
// as HTML; this is about characters that reorder or hide what a person reads.

// Control characters; characters without width or of direction; fillers; tags.
const HIDDEN = new RegExp(
  "[\\u0000-\\u001f\\u007f-\\u009f\\u00ad\\u061c\\u180e\\u115f\\u1160\\u3164\\uffa0\\u200b-\\u200f"
  + "\\u2028-\\u202e\\u2060-\\u206f\\ufeff\\ufff9-\\ufffb\\u{1bca0}-\\u{1bca3}\\u{1d173}-\\u{1d17a}"
  + "\\u{e0000}-\\u{e0fff}]", "gu");
const HIDDEN_ONE = new RegExp(HIDDEN.source, "u");

// A letter with more accents than any language has would cover the lines above and below.
const TOWER = /(\p{M}{6})\p{M}+/gu;

// Longest text that is drawn. The daemon's view keeps texts of 2,000 bytes, models of 64 KiB.
const SHOWN_MAX = 70000;

// Texts that were looked at, because the same names are drawn again and again.
const known = new Map();
const KNOWN_MAX = 4000;

// Returns a part of a line with all such characters visible, line breaks as well.
export function line(text) {
  if (text === null || text === undefined) return "";
  const given = String(text);
  const found = known.get(given);
  if (found !== undefined) return found;
  const shown = show(given, false);
  if (given.length < 300) {
    if (known.size >= KNOWN_MAX) known.clear();
    known.set(given, shown);
  }
  return shown;
}

// Returns a text of several lines with all such characters visible; line breaks stay.
export function lines(text) {
  return text === null || text === undefined ? "" : show(String(text), true);
}

function show(given, keepsBreaks) {
  const text = given.length > SHOWN_MAX ? given.slice(0, SHOWN_MAX) + "…" : given;
  const visible = text.replace(HIDDEN, (c, at) => {
    if (c === "\n" && keepsBreaks) return c;
    // Joiners between two characters beyond ASCII: words of some scripts and emoji need them.
    if ((c === "\u200c" || c === "\u200d") && isJoined(before(text, at)) && isJoined(after(text, at + c.length))) {
      return c;
    }
    const code = c.codePointAt(0);
    if (code < 0x20) return String.fromCodePoint(0x2400 + code);
    if (code === 0x7f) return "\u2421";
    return `\\u{${code.toString(16)}}`;
  });
  return visible.replace(TOWER, "$1…");
}

function before(text, at) {
  const low = text.charCodeAt(at - 1);
  const isPair = low >= 0xdc00 && low <= 0xdfff;
  return text.slice(at - (isPair ? 2 : 1), at);
}

function after(text, at) {
  return at < text.length ? String.fromCodePoint(text.codePointAt(at)) : "";
}

function isJoined(c) {
  return c !== "" && c.codePointAt(0) > 0x7f && !HIDDEN_ONE.test(c);
}
