// A chart of one value over time, as SVG, with steps of plans as marks, and the same as a table for
// those who do not see it.

import { html } from "./html.js";
import { t } from "./language.js";
import { clock, number } from "./time.js";
import { SmallTable } from "./table.js";
import { Text } from "./ui.js";
import { line } from "./visible.js";

const WIDTH = 640;
const HEIGHT = 180;
const LEFT = 52;
const BOTTOM = 24;

// Marks that are drawn: the newest. More would hide the line.
const MARKS = 40;

// Rows of the table: more would only repeat the chart.
const TABLE_ROWS = 20;

// Draws `points` (`{ at, value }`, oldest first) until `until`, with `marks` (`{ at, text }`).
export function Chart({ label, points, marks = [], until }) {
  if (points.length === 0) return html`<p class="empty">${t("chart.empty")}</p>`;
  const from = points[0].at;
  const to = Math.max(until, from + 1000);
  const values = points.map((point) => point.value);
  const [low, high] = rounded(Math.min(...values), Math.max(...values));
  const x = (at) => LEFT + ((at - from) / (to - from)) * (WIDTH - LEFT - 8);
  const y = (value) => 8 + (1 - (value - low) / (high - low)) * (HEIGHT - BOTTOM - 8);
  // A value holds until the next one is reported, so the line has steps.
  const path = points.map((point, at) => (at === 0 ? `M${x(point.at)} ${y(point.value)}` : `H${x(point.at)}V${y(point.value)}`)).join("") + `H${x(to)}`;
  const lines = [low, (low + high) / 2, high];
  const shown = marks.filter((mark) => mark.at >= from && mark.at <= to).slice(-MARKS);
  return html`<figure class="chart"><svg viewBox=${`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label=${t("chart.label", { what: label, low: number(Math.min(...values)), high: number(Math.max(...values)), last: number(values[values.length - 1]) })}>
      ${lines.map((value) => html`<g key=${value}><line class="chart-grid" x1=${LEFT} x2=${WIDTH - 8} y1=${y(value)} y2=${y(value)} /><text class="chart-text" x=${LEFT - 6} y=${y(value) + 4} text-anchor="end">${number(value)}</text></g>`)}
      <text class="chart-text" x=${LEFT} y=${HEIGHT - 6}>${clock(from)}</text><text class="chart-text" x=${WIDTH - 8} y=${HEIGHT - 6} text-anchor="end">${clock(to)}</text>
      ${shown.map((mark, at) => html`<g key=${`m${at}`}><line class="chart-mark" x1=${x(mark.at)} x2=${x(mark.at)} y1="8" y2=${HEIGHT - BOTTOM} /><title>${line(mark.text)}</title></g>`)}
      <path class="chart-line" d=${path} fill="none" /><circle class="chart-last" cx=${x(to)} cy=${y(values[values.length - 1])} r="3" /></svg>
    ${shown.length > 0 && html`<figcaption class="muted small">${t("chart.marks")}: ${shown.slice(-6).map((mark, at) => html`<span key=${at} class="chart-note">${clock(mark.at)} <${Text} of=${mark.text} /></span>`)}</figcaption>`}
    <details><summary>${t("chart.table")}</summary><${SmallTable} label=${label} head=${[t("chart.at"), t("chart.value")]} rows=${points.slice(-TABLE_ROWS).reverse().map((point) => [clock(point.at), number(point.value, 4)])} /></details></figure>`;
}

// Bounds of the axis with some room, so that a constant value is a line in the middle.
function rounded(low, high) {
  const room = (high - low) * 0.1 || Math.max(1, Math.abs(high) * 0.05);
  return [low - room, high + room];
}
