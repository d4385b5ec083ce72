// A table that draws only the rows that can be seen, so that thousands of rows cost as much as
// thirty. Screen readers are told the number of all rows.

import { Component, html, useEffect, useLayoutEffect, useRef, useState } from "./html.js";
import { t } from "./language.js";
import { Empty } from "./ui.js";

// Heights of a row in pixels; app.css has the same. On a narrow screen a row has two lines.
const ROW_WIDE = 38;
const ROW_NARROW = 62;
const NARROW = matchMedia("(max-width: 720px)");

// Rows that are drawn above and below what is seen, so that the Tab key reaches the next ones.
const BEYOND = 12;

// Rows that come and go together.
const BLOCK = 6;

// Tables with fewer rows are drawn whole.
const WHOLE = 60;

// Draws a table. `columns`: `{ key, title, cell: (row) => …, width, isMain }`; `rows`: `{ key, row }`.
export function Table({ label, columns, rows, topic, empty }) {
  const body = useRef(null);
  const [range, setRange] = useState([0, 40]);
  const [isNarrow, setNarrow] = useState(NARROW.matches);
  const height = isNarrow ? ROW_NARROW : ROW_WIDE;
  const isWhole = rows.length <= WHOLE;

  useEffect(() => {
    const changed = () => setNarrow(NARROW.matches);
    NARROW.addEventListener("change", changed);
    return () => NARROW.removeEventListener("change", changed);
  }, []);

  const look = () => {
    if (!body.current || isWhole) return;
    const top = body.current.getBoundingClientRect().top;
    // In whole blocks: a scroll by a few pixels draws nothing.
    const first = Math.max(0, Math.floor((-top / height - BEYOND) / BLOCK) * BLOCK);
    const last = Math.ceil(((innerHeight - top) / height + BEYOND) / BLOCK) * BLOCK;
    setRange((before) => (before[0] === first && before[1] === last ? before : [first, last]));
  };

  useLayoutEffect(look, [rows.length, height]);
  useEffect(() => {
    let frame = null;
    const later = () => {
      frame ??= requestAnimationFrame(() => { frame = null; look(); });
    };
    addEventListener("scroll", later, { passive: true });
    addEventListener("resize", later, { passive: true });
    return () => {
      cancelAnimationFrame(frame);
      removeEventListener("scroll", later);
      removeEventListener("resize", later);
    };
  }, [height, isWhole]);

  if (rows.length === 0) return html`<${Empty} topic=${topic}>${empty}<//>`;
  const shown = [];
  const [first, last] = isWhole ? [0, rows.length] : range;
  // The row with the focus stays, wherever one scrolls: a focus must not be lost.
  const focused = body.current?.contains(document.activeElement)
    ? document.activeElement.closest("[data-row]")?.dataset.row : undefined;
  for (let at = 0; at < rows.length; at += 1) {
    if ((at >= first && at < last) || rows[at].key === focused) shown.push(at);
  }
  const template = columns.map((column) => column.width ?? "minmax(0, 1fr)").join(" ");
  return html`<div class="table" role="table" aria-label=${label} aria-rowcount=${rows.length + 1} aria-colcount=${columns.length}>
    <div role="rowgroup" class="table-head"><div role="row" class="table-row" aria-rowindex="1" style=${{ gridTemplateColumns: template }}>
      ${columns.map((column) => html`<div role="columnheader" key=${column.key} class="cell cell-${column.key} ${column.class ?? ""}">${column.title}</div>`)}
    </div></div>
    <div role="rowgroup" class="table-body" ref=${body} style=${{ height: `${rows.length * height}px` }}>
      ${shown.map((at) => html`<${Row} key=${rows[at].key} at=${at} id=${rows[at].key} row=${rows[at].row} columns=${columns} height=${height} template=${template} />`)}
    </div></div>`;
}

// One row. It is drawn again only if its row object is another one, or it moves: ages in it tick by
// themselves.
class Row extends Component {
  shouldComponentUpdate(next) {
    const { at, row, height, template, columns } = this.props;
    return at !== next.at || row !== next.row || height !== next.height || template !== next.template
      || columns !== next.columns;
  }

  render({ at, id, row, columns, height, template }) {
    return html`<div role="row" class="table-row ${at % 2 ? "odd" : ""}" data-row=${id} aria-rowindex=${at + 2}
      style=${{ gridTemplateColumns: template, transform: `translateY(${at * height}px)`, height: `${height}px` }}>
      ${columns.map((column) => html`<div role="cell" key=${column.key} class="cell cell-${column.key} ${column.isMain ? "cell-main" : ""} ${column.class ?? ""}">${column.cell(row)}</div>`)}
    </div>`;
  }
}

// A small table without windows, for the parts of a detail page.
export function SmallTable({ label, head, rows, empty }) {
  if (rows.length === 0) return html`<p class="empty">${empty ?? t("empty.nothing")}</p>`;
  return html`<div class="scroll" tabindex="0" role="group" aria-label=${label}><table class="small-table"><caption class="hidden-visually">${label}</caption>
    <thead><tr>${head.map((title) => html`<th scope="col" key=${title}>${title}</th>`)}</tr></thead>
    <tbody>${rows.map((cells, at) => html`<tr key=${at}>${cells.map((cell, column) => html`<td key=${column}>${cell}</td>`)}</tr>`)}</tbody>
  </table></div>`;
}
