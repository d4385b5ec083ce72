// Moments and durations for people: in the zone and the manner of the browser, by the clock of the
// daemon, which may differ from that of the phone.

import { html, useEffect, useState } from "./html.js";
import { language, t } from "./language.js";

// What the daemon's clock is ahead of this browser's, in milliseconds.
let ahead = 0;

// Takes note of the daemon's time, which comes with each event.
export function noteServerTime(now) {
  if (Number.isFinite(now)) ahead = now - Date.now();
}

// Returns the present moment by the daemon's clock.
export function now() {
  return Date.now() + ahead;
}

// One clock for all ages on the page.
const tickers = new Set();
setInterval(() => tickers.forEach((tick) => tick()), 1000);

// Returns the present moment, and draws the component again each second.
export function useNow() {
  const [, tick] = useState(0);
  useEffect(() => {
    const again = () => tick((n) => n + 1);
    tickers.add(again);
    return () => tickers.delete(again);
  }, []);
  return now();
}

const formats = new Map();

function format(kind, options) {
  const key = language + kind;
  if (!formats.has(key)) formats.set(key, new Intl.DateTimeFormat(language, options));
  return formats.get(key);
}

// Returns the time of day, with the date if it is another day.
export function clock(moment) {
  if (moment === null || moment === undefined) return "";
  const date = new Date(moment);
  const isToday = date.toDateString() === new Date(now()).toDateString();
  const time = { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" };
  if (isToday) return format("time", time).format(date);
  return format("day", { ...time, month: "short", day: "numeric" }).format(date);
}

// Time within which a weekday says which day is meant, in milliseconds.
const WEEK_MS = 6 * 24 * 3600 * 1000;

// Returns a moment to come without its seconds: `Thu 08:00`, or with its date if it is far away.
export function when(moment) {
  if (moment === null || moment === undefined) return "";
  const date = new Date(moment);
  const time = { hour: "2-digit", minute: "2-digit", hourCycle: "h23" };
  const isToday = date.toDateString() === new Date(now()).toDateString();
  if (isToday) return format("minute", time).format(date);
  const isSoon = Math.abs(moment - now()) < WEEK_MS;
  if (isSoon) return format("weekday", { ...time, weekday: "short" }).format(date);
  return format("date", { ...time, year: "numeric", month: "short", day: "numeric" }).format(date);
}

// Returns a duration in two units at most: `3.1 s`, `5 min 20 s`, `3 h 5 min`, `2 d 4 h`.
export function duration(milliseconds) {
  if (milliseconds === null || milliseconds === undefined) return "";
  const ms = Math.max(0, milliseconds);
  const units = (n, unit) => `${n} ${t(`unit.${unit}`)}`;
  if (ms === 0) return units(0, "s");
  if (ms < 1000) return units(Math.round(ms), "ms");
  if (ms < 10000) return units(new Intl.NumberFormat(language, { maximumFractionDigits: 1 }).format(ms / 1000), "s");
  const s = Math.round(ms / 1000);
  if (s < 60) return units(s, "s");
  const two = (big, small, size, bigUnit, smallUnit) =>
    small === 0 ? units(big, bigUnit) : `${units(big, bigUnit)} ${units(small, smallUnit)}`;
  if (s < 3600) return two(Math.floor(s / 60), s % 60, 60, "min", "s");
  const min = Math.floor(s / 60);
  if (min < 1440) return two(Math.floor(min / 60), min % 60, 60, "h", "min");
  const h = Math.floor(min / 60);
  return two(Math.floor(h / 24), h % 24, 24, "d", "h");
}

// Returns an age without fractions of a second, because it is drawn once a second.
export function age(milliseconds) {
  if (milliseconds === null || milliseconds === undefined) return "";
  return milliseconds < 1000 ? t("time.now") : duration(Math.floor(milliseconds / 1000) * 1000);
}

// A moment: the time of day.
export function At({ at }) {
  if (at === null || at === undefined) return null;
  return html`<time datetime=${new Date(at).toISOString()}>${clock(at)}</time>`;
}

// The age of a moment, which grows by itself.
export function Since({ at }) {
  const present = useNow();
  if (at === null || at === undefined) return null;
  return html`<time datetime=${new Date(at).toISOString()} title=${clock(at)}>${age(present - at)}</time>`;
}

// The time that is left until a moment, which shrinks by itself.
export function Until({ at }) {
  const present = useNow();
  if (at === null || at === undefined) return null;
  return html`<time datetime=${new Date(at).toISOString()} title=${clock(at)}>${age(Math.max(0, at - present))}</time>`;
}

// A number for people.
export function number(value, digits = 2) {
  return new Intl.NumberFormat(language, { maximumFractionDigits: digits }).format(value);
}

// How much later than usual something is: it grows while it runs.
export function Late({ row }) {
  const present = useNow();
  const late = row.late_since ? present - row.late_since : row.late_ms;
  if (!(late >= 1000)) return null;
  return html` <span class="late">${t("goal.late", { time: age(late) })}</span>`;
}
