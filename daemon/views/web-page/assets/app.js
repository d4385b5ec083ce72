// The page as a whole: what is around every page, and which page an address shows.

import { becomeScreen, me, refreshMe } from "./lib/api.js";
import { html, render, useEffect, useLayoutEffect, useRef, useState } from "./lib/html.js";
import { recall, remember } from "./lib/keeping.js";
import { LANGUAGES, chooseLanguage, language, loadLanguage, t } from "./lib/language.js";
import { go, place, to } from "./lib/router.js";
import "./lib/series.js";
import { useFollowed } from "./lib/state.js";
import { StopButton, StopPanel } from "./lib/stop.js";
import { clock } from "./lib/time.js";
import { link, useTopic } from "./lib/topics.js";
import { Guarded, PageHead, Text } from "./lib/ui.js";
import { line } from "./lib/visible.js";
import { showAs, shownAs } from "./lib/words.js";
import { ActivityPage } from "./pages/activity.js";
import { AgentPage } from "./pages/agent.js";
import { AgentsPage } from "./pages/agents.js";
import { AskPage } from "./pages/ask.js";
import { ConversationPage, ConversationsPage } from "./pages/conversations.js";
import { DaemonsPage } from "./pages/daemons.js";
import { FloorPage } from "./pages/floor.js";
import { GoalPage } from "./pages/goal.js";
import { GoalsPage } from "./pages/goals.js";
import { HistoryPage } from "./pages/history.js";
import { InboxPage } from "./pages/inbox.js";
import { OverviewPage } from "./pages/overview.js";
import { PeoplePage } from "./pages/people.js";
import { QuestionsPage } from "./pages/questions.js";
import { RobotPage } from "./pages/robot.js";
import { SignInPage } from "./pages/sign-in.js";
import { WorldPage } from "./pages/world.js";

// The pages at the side, in groups: what one looks at each day first.
const GROUPS = [
  ["", "goals", "ask", "questions", "floor"],
  ["agents", "world", "activity", "history"],
  ["conversations", "daemons", "inbox", "people"],
];

const PAGES = {
  "": OverviewPage, goals: GoalsPage, ask: AskPage, questions: QuestionsPage, floor: FloorPage, agents: AgentsPage,
  world: WorldPage, activity: ActivityPage, history: HistoryPage, conversations: ConversationsPage,
  daemons: DaemonsPage, inbox: InboxPage, people: PeoplePage, "sign-in": OverviewPage,
};

// Pages about one thing.
const DETAILS = { goals: GoalPage, agents: AgentPage, conversations: ConversationPage, robot: RobotPage };

function pageOf(parts) {
  if (parts.length <= 1) return [PAGES[parts[0] ?? ""] ?? null, undefined];
  return [parts.length === 2 ? DETAILS[parts[0]] ?? null : null, parts[1]];
}

function App() {
  const person = useFollowed(me);
  const [spoken, setSpoken] = useState(language);
  useLayoutEffect(() => { document.body.classList.toggle("is-signed-out", !person); }, [person]);
  const speak = async (tag) => {
    try {
      await chooseLanguage(tag);
      setSpoken(tag);
    } catch {
      // The daemon is not reached; the page says so, and keeps its language.
    }
  };
  if (person === undefined) return html`<main class="starting"><p role="status">${t("app.starting")}</p></main>`;
  if (person === null) return html`<${SignedOut} key=${spoken} onSpeak=${speak} />`;
  if (person.screen) return html`<${Screen} key=${spoken} person=${person} onSpeak=${speak} />`;
  return html`<${Signed} key=${spoken} person=${person} onSpeak=${speak} />`;
}

function SignedOut({ onSpeak }) {
  useEffect(() => { document.title = `${t("sign-in.title")} · Althing`; }, []);
  return html`<header class="top top-plain"><span class="brand"><${Mark} />Althing</span><${Choices} onSpeak=${onSpeak} /></header>
    <main id="main" class="main-plain"><${SignInPage} /></main>`;
}

// The browser of a robot, at which nobody has signed in: it shows the robot, and who stands before it
// can sign in.
function Screen({ person, onSpeak }) {
  const where = useFollowed(place);
  const [isSigningIn, setSigningIn] = useState(false);
  const own = to("robot", person.screen);
  useEffect(() => { if (where.path !== own) go(own); }, [where.path, own]);
  useEffect(() => { document.title = `${line(person.screen)} · Althing`; }, [person.screen]);
  return html`<header class="top"><span class="brand"><${Mark} /><span class="brand-name"><${Text} of=${person.ecosystem} /></span></span><div class="top-verdict-place"></div><${StopButton} /></header>
    <${Connection} />
    <div class="body body-board"><main id="main" tabindex="-1"><${Guarded}><${StopPanel} /><//>
      <${Guarded}>${isSigningIn ? html`<${SignInPage} />` : html`<${RobotPage} name=${person.screen} />`}<//>
      <footer class="screen-foot"><button type="button" class="button" onClick=${() => setSigningIn(!isSigningIn)}>${isSigningIn ? t("screen.back") : t("sign-in.title")}</button><${Choices} onSpeak=${onSpeak} /></footer></main></div>`;
}

function Signed({ person, onSpeak }) {
  const where = useFollowed(place);
  const [isMenuOpen, setMenuOpen] = useState(false);
  const menu = useRef(null);
  const [Page, name] = pageOf(where.parts);
  const isBoard = where.parts[0] === "robot";
  const [drawn, setDrawn] = useState(where.path);
  useEffect(() => { setDrawn(where.path); setMenuOpen(false); }, [where.path]);
  useEffect(() => {
    const key = ["goals", "agents", "conversations"].includes(where.parts[0]) && name !== undefined ? line(name) : t(`nav.${where.parts[0] || "overview"}`);
    document.title = `${isBoard ? line(name) : key} · ${line(person.ecosystem)} · Althing`;
  }, [where.path, person.ecosystem]);
  const closeMenu = (event) => { if (event.key === "Escape" && isMenuOpen) { setMenuOpen(false); menu.current?.focus(); } };
  return html`<a class="skip" href="#main">${t("app.skip")}</a>
    <header class="top" onKeyDown=${closeMenu}>
      ${!isBoard && html`<button type="button" class="menu-button" ref=${menu} aria-expanded=${isMenuOpen ? "true" : "false"} aria-controls="navigation" onClick=${() => setMenuOpen(!isMenuOpen)}>
        <svg viewBox="0 0 20 20" aria-hidden="true"><path d="M2 5h16M2 10h16M2 15h16" /></svg><span class="hidden-visually">${t("app.menu")}</span></button>`}
      <a class="brand" href="/" aria-label=${t("app.home", { ecosystem: line(person.ecosystem) })}><${Mark} /><span class="brand-name"><${Text} of=${person.ecosystem} /></span></a>
      <${Verdict} />
      <${StopButton} />
    </header>
    <${Connection} />
    <${CertificateEnd} at=${person.certificate_ends_at} />
    <div class="body ${isBoard ? "body-board" : ""} ${isMenuOpen ? "menu-open" : ""}">
      ${!isBoard && html`<aside class="side" id="navigation" aria-label=${t("app.side")} onKeyDown=${closeMenu}><${Navigation} first=${where.parts[0] ?? ""} /><${Choices} onSpeak=${onSpeak} />
        <p class="muted small who"><a href="/people"><${Text} of=${person.person} /></a> · <${Text} of=${person.daemon} /></p></aside>`}
      <main id="main" tabindex="-1"><${Guarded} key=${`stop${drawn}`}><${StopPanel} /><//>
        <${Guarded} key=${where.path}>${Page ? html`<${Page} key=${where.path} name=${name} />` : html`<${NoPage} />`}<//></main>
    </div>`;
}

function NoPage() {
  return html`<${PageHead} title=${t("app.no-page")} /><p>${t("app.no-page-about")} <a href="/">${t("nav.overview")}</a></p>`;
}

function Navigation({ first }) {
  const questions = useTopic("questions").list.length;
  const waiting = useTopic("inbox").list.filter(({ row }) => !(row.discovered ?? row).joined).length;
  const badges = { questions, inbox: waiting };
  const item = (page) => html`<li key=${page}><a href=${`/${page}`} aria-current=${page === first ? "page" : undefined}>
    <span>${t(`nav.${page || "overview"}`)}</span>${badges[page] > 0 && html`<span class="badge">${badges[page]}<span class="hidden-visually"> ${t("app.waiting")}</span></span>`}</a></li>`;
  return html`<nav aria-label=${t("app.pages")}>${GROUPS.map((group, at) => html`<ul key=${at}>${group.map(item)}</ul>`)}</nav>`;
}

// Whether all is well, on every page.
function Verdict() {
  const overview = useTopic("overview").one;
  const since = useFollowed(link).since;
  const verdict = since !== null ? "unknown" : overview?.verdict;
  return html`<div class="top-verdict-place" role="status">${verdict && html`<a class="top-verdict top-verdict-${verdict}" href="/">
    <span aria-hidden="true">${{ well: "✓", attention: "!", bad: "✗" }[verdict] ?? "?"}</span> <span class="top-verdict-text">${t(`verdict.${verdict}`)}</span></a>`}</div>`;
}

// Says when the page is not up to date; what it shows is grey until it is again.
function Connection() {
  const { since, problem } = useFollowed(link);
  useLayoutEffect(() => { document.body.classList.toggle("is-old", since !== null); }, [since]);
  return html`<div role="status" class="connection-place">${since !== null && html`<p class="connection"><span aria-hidden="true">⚠ </span>${problem ? html`<${Text} of=${problem} />` : t("app.not-connected", { time: clock(since) })}</p>`}</div>`;
}

// Says in time that browsers will refuse this page.
function CertificateEnd({ at }) {
  if (!at) return null;
  const days = Math.max(0, Math.floor((at - Date.now()) / 86400000));
  return html`<p class="certificate-end" role="status"><span aria-hidden="true">! </span>${t("app.certificate-ends", { n: days })}</p>`;
}

// Language, words or PDDL, and colors.
function Choices({ onSpeak }) {
  const shown = useFollowed(shownAs);
  const [theme, setTheme] = useState(recall("theme") ?? "auto");
  const choose = (one) => { remember("theme", one); setTheme(one); applyTheme(one); };
  return html`<div class="choices-row">
    <label><span class="hidden-visually">${t("app.language")}</span><select value=${language} onChange=${(event) => onSpeak(event.target.value)}>${Object.entries(LANGUAGES).map(([tag, name]) => html`<option key=${tag} value=${tag} lang=${tag}>${name}</option>`)}</select></label>
    <label><span class="hidden-visually">${t("app.words")}</span><select value=${shown} onChange=${(event) => showAs(event.target.value)}>${["words", "pddl"].map((one) => html`<option key=${one} value=${one}>${t(`words.${one}`)}</option>`)}</select></label>
    <label><span class="hidden-visually">${t("app.theme")}</span><select value=${theme} onChange=${(event) => choose(event.target.value)}>${["auto", "light", "dark"].map((one) => html`<option key=${one} value=${one}>${t(`theme.${one}`)}</option>`)}</select></label></div>`;
}

function Mark() {
  return html`<svg class="mark" viewBox="0 0 24 24" aria-hidden="true"><path d="M3 20L12 4l9 16M7.5 13.5h9" /></svg>`;
}

function applyTheme(theme) {
  if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
  else delete document.documentElement.dataset.theme;
}

// A person whose focus is on something that goes away, such as a question that another one has
// answered, goes on at the heading of the page. A focus that is elsewhere is left alone.
function keepFocus(root) {
  let last = null;
  document.addEventListener("focusin", (event) => { last = event.target; });
  new MutationObserver(() => {
    if (last === null || last.isConnected) return;
    last = null;
    if (document.activeElement === document.body) document.querySelector("main h1[tabindex]")?.focus({ preventScroll: true });
  }).observe(root, { childList: true, subtree: true });
}

// The first wait until the daemon is asked again, if it is not reached at the start.
const ASK_AGAIN = 3000;

// Does something that needs the daemon, again and again until it is reached.
async function untilReached(what) {
  for (;;) {
    try {
      return await what();
    } catch {
      await new Promise((resolve) => setTimeout(resolve, ASK_AGAIN));
    }
  }
}

async function begin() {
  applyTheme(recall("theme"));
  await untilReached(loadLanguage);
  const root = document.getElementById("app");
  root.replaceChildren();
  render(html`<${App} />`, root);
  keepFocus(root);
  await untilReached(becomeScreen);
  await untilReached(refreshMe);
}

begin();
