// The floor plan: rooms and ways, robots where they are and where they go. It is laid out by itself;
// a person may move the rooms, and lay a picture beneath. A list says the same in words.

import { html, useEffect, useRef, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { forget, recall, remember } from "../lib/keeping.js";
import { useTopic } from "../lib/topics.js";
import { SmallTable } from "../lib/table.js";
import { Card, Empty, Link, PageHead, State, Text } from "../lib/ui.js";
import { line } from "../lib/visible.js";
import { go, to } from "../lib/router.js";

const ROOM_WIDTH = 150;
const ROOM_HEIGHT = 84;
const STEP_X = 210;
const STEP_Y = 140;
const MARGIN = 24;

// Distance by which an arrow key moves a room.
const NUDGE = 10;

// Longest side of the picture beneath, in pixels: more is not seen, and a browser keeps 5 MB.
const PICTURE_MAX = 1400;
const PICTURE_BYTES_MAX = 3 << 20;

export function FloorPage() {
  const topic = useTopic("floor");
  const plan = planOf(topic);
  const [moved, setMoved] = useState(() => recall("floor.places") ?? {});
  const [picture, setPicture] = useState(() => recall("floor.picture"));
  const [isArranging, setArranging] = useState(false);
  const [problem, setProblem] = useState("");
  const file = useRef(null);
  const place = (name, at) => setMoved((before) => { const next = { ...before, [name]: at }; remember("floor.places", next); return next; });
  const choose = async (event) => {
    const chosen = event.target.files[0];
    event.target.value = "";
    if (!chosen) return;
    try {
      const data = await shrunk(chosen);
      setPicture(data);
      setProblem(remember("floor.picture", data) ? "" : t("floor.picture-not-kept"));
    } catch {
      setProblem(t("floor.picture-unreadable"));
    }
  };
  if (plan.rooms.length === 0) {
    return html`<${PageHead} title=${t("nav.floor")} /><${Empty} topic=${topic}>${plan.because ? html`<${Text} of=${plan.because} />` : t("empty.floor")}<//>`;
  }
  const isChanged = Object.keys(moved).length > 0;
  return html`<${PageHead} title=${t("nav.floor")}>
      <button type="button" class="button" aria-pressed=${isArranging ? "true" : "false"} onClick=${() => setArranging(!isArranging)}>${isArranging ? t("floor.arranged") : t("floor.arrange")}</button>
      ${isArranging && html`<input ref=${file} type="file" accept="image/*" class="hidden-visually" tabindex="-1" aria-hidden="true" onChange=${choose} />
        <button type="button" class="button" onClick=${() => file.current.click()}>${t("floor.picture")}</button>
        ${picture && html`<button type="button" class="button" onClick=${() => { forget("floor.picture"); setPicture(null); }}>${t("floor.no-picture")}</button>`}
        ${isChanged && html`<button type="button" class="button" onClick=${() => { forget("floor.places"); setMoved({}); }}>${t("floor.reset")}</button>`}`}
    <//>
    ${isArranging && html`<p class="muted">${t("floor.how")}</p>`}
    <p role="status" class="problem">${problem}</p>
    <${Drawing} plan=${plan} moved=${moved} picture=${picture} isArranging=${isArranging} onPlace=${place} />
    ${plan.more > 0 && html`<p class="muted">${t("floor.more", { n: plan.more })}</p>`}
    <${Card} title=${t("floor.robots")}><${SmallTable} label=${t("floor.robots")} head=${[t("floor.robot"), t("floor.room"), t("floor.goes-to"), t("floor.path")]} empty=${t("floor.no-robots")}
      rows=${plan.robots.map((robot) => [
        html`<${Link} page="agents" name=${robot.agent} />${robot.is_stopped && html` <${State} of="stopped" />`}${robot.is_stale && html` <${State} of="stale" />`}`,
        html`<${Text} of=${robot.room ?? t("state.unknown")} />`, html`<${Text} of=${robot.moves_to ?? ""} />`,
        robot.conversation ? html`<${Link} page="goals" name=${robot.conversation}><${Text} of=${robot.path.join(" → ") || t("floor.for-goal")} /><//>` : html`<${Text} of=${robot.path.join(" → ")} />`])} /><//>
    <${Card} title=${t("floor.rooms")}><${SmallTable} label=${t("floor.rooms")} head=${[t("floor.room"), t("floor.robots"), t("floor.known"), t("floor.ways")]}
      rows=${plan.rooms.map((room) => [
        html`<${Text} of=${room.name} />${room.is_stopped && html` <${State} of="stopped" />`}`, html`<${Text} of=${room.robots.join(", ")} />`,
        html`<${Text} of=${room.facts.join(", ")} />${room.is_stale && html` <${State} of="stale" />`}`,
        html`<${Text} of=${plan.ways.filter((way) => way.from === room.name || (way.both_ways && way.to === room.name)).map((way) => (way.from === room.name ? way.to : way.from)).join(", ")} />`])} /><//>`;
}

// The plan, from the rows of its topic.
export function planOf(topic) {
  const rooms = [];
  const robots = [];
  for (const { key, row } of topic.list) {
    if (key.startsWith("room/")) rooms.push(row);
    else if (key.startsWith("robot/")) robots.push(row);
  }
  const rest = topic.rows.get("plan");
  return { rooms, robots, ways: topic.rows.get("ways") ?? [], more: rest?.more_rooms ?? 0, because: rest?.empty_because ?? "" };
}

// Where the rooms are: columns and rows of the daemon's layout, or where a person has put them.
function placesOf(rooms, moved) {
  const columns = [...new Set(rooms.map((room) => room.x))].sort((one, other) => one - other);
  const inColumn = new Map();
  for (const room of rooms) inColumn.set(room.x, (inColumn.get(room.x) ?? 0) + 1);
  const tallest = Math.max(...inColumn.values());
  const height = MARGIN * 2 + (tallest - 1) * STEP_Y + ROOM_HEIGHT;
  const places = new Map();
  for (const room of rooms) {
    const given = moved[room.name];
    const isGiven = Array.isArray(given) && given.length === 2 && given.every(Number.isFinite);
    places.set(room.name, isGiven ? { x: given[0], y: given[1] }
      : { x: MARGIN + columns.indexOf(room.x) * STEP_X, y: MARGIN + room.y * (height - MARGIN * 2 - ROOM_HEIGHT) });
  }
  let right = 0;
  let bottom = 0;
  for (const at of places.values()) {
    right = Math.max(right, at.x + ROOM_WIDTH + MARGIN);
    bottom = Math.max(bottom, at.y + ROOM_HEIGHT + MARGIN);
  }
  return { places, width: right, height: bottom };
}

const middle = (at) => ({ x: at.x + ROOM_WIDTH / 2, y: at.y + ROOM_HEIGHT / 2 });

function Drawing({ plan, moved, picture, isArranging, onPlace }) {
  const svg = useRef(null);
  const [held, setHeld] = useState(null);
  const { places, width, height } = placesOf(plan.rooms, moved);
  const frame = useRef({ width, height });
  // While a room is held, the drawing keeps its size: it must not move under the pointer.
  if (held === null) frame.current = { width, height };
  const point = (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.current.getScreenCTM().inverse());
    return { x: at.x, y: at.y };
  };
  const hold = (name) => (event) => {
    if (!isArranging) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    const at = point(event);
    const from = places.get(name);
    setHeld({ name, dx: at.x - from.x, dy: at.y - from.y });
  };
  const drag = (event) => {
    if (held === null) return;
    const at = point(event);
    onPlace(held.name, [Math.max(0, Math.round(at.x - held.dx)), Math.max(0, Math.round(at.y - held.dy))]);
  };
  const nudge = (name) => (event) => {
    const by = { ArrowLeft: [-NUDGE, 0], ArrowRight: [NUDGE, 0], ArrowUp: [0, -NUDGE], ArrowDown: [0, NUDGE] }[event.key];
    if (!by || !isArranging) return;
    event.preventDefault();
    const from = places.get(name);
    onPlace(name, [Math.max(0, from.x + by[0]), Math.max(0, from.y + by[1])]);
  };
  const size = frame.current;
  return html`<div class="floor ${isArranging ? "floor-arranging" : ""}" tabindex="0" role="group" aria-label=${t("floor.drawing")}>
    <svg ref=${svg} class="floor-svg" viewBox=${`0 0 ${size.width} ${size.height}`} style=${{ minWidth: `${Math.min(size.width, 900) * 0.62}px`, maxWidth: `${size.width * 1.25}px` }}
      role=${isArranging ? "group" : "img"} aria-label=${t("floor.label", { rooms: plan.rooms.length, robots: plan.robots.length })}
      onPointerMove=${drag} onPointerUp=${() => setHeld(null)} onPointerCancel=${() => setHeld(null)}>
      ${picture && html`<image href=${picture} x="0" y="0" width=${size.width} height=${size.height} preserveAspectRatio="xMidYMid meet" opacity="0.55" />`}
      ${plan.ways.map((way) => html`<${Way} key=${`${way.from}/${way.to}`} way=${way} places=${places} />`)}
      ${plan.robots.map((robot) => html`<${Path} key=${robot.agent} robot=${robot} places=${places} />`)}
      ${plan.rooms.map((room) => html`<${Room} key=${room.name} room=${room} at=${places.get(room.name)} isArranging=${isArranging} onHold=${hold(room.name)} onKey=${nudge(room.name)} />`)}
      ${plan.robots.filter((robot) => places.has(robot.room)).map((robot) => html`<${Robot} key=${robot.agent} robot=${robot} plan=${plan} places=${places} />`)}
    </svg></div>`;
}

function Way({ way, places }) {
  const from = places.get(way.from);
  const target = places.get(way.to);
  if (!from || !target) return null;
  const [one, other] = [middle(from), middle(target)];
  const half = { x: (one.x + other.x) / 2, y: (one.y + other.y) / 2 };
  const angle = (Math.atan2(other.y - one.y, other.x - one.x) * 180) / Math.PI;
  return html`<g class="way"><line x1=${one.x} y1=${one.y} x2=${other.x} y2=${other.y} />
    ${!way.both_ways && html`<path d="M-5 -5L5 0L-5 5" transform=${`translate(${half.x} ${half.y}) rotate(${angle})`} />`}</g>`;
}

function Path({ robot, places }) {
  const rooms = [robot.room, ...robot.path].filter((name) => places.has(name));
  if (rooms.length < 2) return null;
  return html`<polyline class="path ${robot.is_stale ? "path-stale" : ""}" points=${rooms.map((name) => { const at = middle(places.get(name)); return `${at.x},${at.y}`; }).join(" ")} />`;
}

const short = (text, length) => { const shown = line(text); return shown.length > length ? `${shown.slice(0, length - 1)}…` : shown; };

function Room({ room, at, isArranging, onHold, onKey }) {
  const label = [room.name, ...room.robots, ...room.facts, room.is_stale && t("state.stale"), room.is_stopped && t("state.stopped")].filter(Boolean).map(line).join(", ");
  return html`<g class="room ${room.is_stale ? "room-stale" : ""} ${room.is_stopped ? "room-stopped" : ""}" transform=${`translate(${at.x} ${at.y})`}
    tabindex=${isArranging ? "0" : undefined} role=${isArranging ? "button" : undefined} aria-roledescription=${isArranging ? t("floor.move") : undefined} onPointerDown=${onHold} onKeyDown=${onKey}>
    ${!isArranging && html`<title>${label}</title>`}<rect width=${ROOM_WIDTH} height=${ROOM_HEIGHT} rx="8" />
    <text class="room-name" x="10" y="20">${short(room.name, 17)}</text>
    ${room.facts.slice(0, 2).map((fact, n) => html`<text key=${n} class="room-fact" x="10" y=${ROOM_HEIGHT - 22 + n * 14}>${short(fact, 23)}</text>`)}
    ${room.is_stopped && html`<text class="room-sign" x=${ROOM_WIDTH - 10} y="20" text-anchor="end">■</text>`}</g>`;
}

// A robot in its room, or on the way to the next one.
function Robot({ robot, plan, places }) {
  const room = plan.rooms.find((one) => one.name === robot.room);
  const at = places.get(robot.room);
  const count = Math.max(1, room?.robots.length ?? 1);
  const position = Math.max(0, room?.robots.indexOf(robot.agent) ?? 0);
  let x = at.x + 22 + Math.min(position, 5) * Math.min(40, (ROOM_WIDTH - 44) / count);
  let y = at.y + 40;
  const next = places.get(robot.moves_to);
  if (next) {
    const [one, other] = [middle(at), middle(next)];
    x = one.x + (other.x - one.x) * 0.5;
    y = one.y + (other.y - one.y) * 0.5;
  }
  const sign = robot.is_stopped ? "■" : robot.is_stale ? "?" : next ? "▶" : "";
  const open = () => go(to("agents", robot.agent));
  return html`<g class="robot ${robot.is_stale ? "robot-stale" : ""} ${robot.is_stopped ? "robot-stopped" : ""}" style=${{ transform: `translate(${x}px, ${y}px)` }} onClick=${open}>
    <title>${line(robot.agent)}</title><circle r="11" /><text class="robot-sign" y="4" text-anchor="middle">${sign}</text>
    <text class="robot-name" x="15" y="4">${short(robot.agent, 16)}</text></g>`;
}

// Reads a picture and makes it small enough for the browser to keep. Whatever the file is, only its
// pixels are kept.
async function shrunk(file) {
  const bitmap = await createImageBitmap(file);
  const scale = Math.min(1, PICTURE_MAX / Math.max(bitmap.width, bitmap.height));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(bitmap.width * scale));
  canvas.height = Math.max(1, Math.round(bitmap.height * scale));
  canvas.getContext("2d").drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  const data = canvas.toDataURL("image/webp", 0.8);
  if (data.length > PICTURE_BYTES_MAX) throw new Error("the picture is too large");
  return data;
}
