// The daemons: round trips, who leads and stands by, certificates, mailboxes.

import { html } from "../lib/html.js";
import { t } from "../lib/language.js";
import { Since, number } from "../lib/time.js";
import { useTopic } from "../lib/topics.js";
import { Empty, Facts, Link, PageHead, State, Text, Told } from "../lib/ui.js";

// Days before the end of a certificate at which a person should look at it.
const CERTIFICATE_SOON = 30;

// Agents that are named; a daemon may lead hundreds.
const NAMED = 12;

export function DaemonsPage() {
  const topic = useTopic("daemons");
  return html`<${PageHead} title=${t("nav.daemons")} />
    <div class="cards cards-wide">${topic.list.map(({ key, row }) => html`<${Daemon} key=${key} row=${row} />`)}</div>
    ${topic.list.length === 0 && html`<${Empty} topic=${topic}>${t("empty.daemons")}<//>`}`;
}

function Daemon({ row }) {
  const reached = row.is_reached === null ? "unknown" : row.is_reached ? "reached" : "not-reached";
  const mail = row.mailboxes;
  const days = row.certificate_days_left;
  return html`<article class="card"><div class="card-head"><h2><${Text} of=${row.daemon} /></h2><${State} of=${reached} /></div>
    ${row.problems.length > 0 && html`<ul class="problems">${row.problems.map((problem, at) => html`<li key=${at}><${Told} of=${problem} /></li>`)}</ul>`}
    <${Facts} rows=${[
      [t("daemon.round-trip"), row.round_trip_micros !== null && `${number(row.round_trip_micros / 1000, 1)} ms${row.usual_round_trip_micros ? ` (${t("daemon.usual", { time: number(row.usual_round_trip_micros / 1000, 1) })})` : ""}`],
      [t("daemon.agents"), number(row.agents)],
      [t("daemon.leads"), row.leads.length > 0 && html`<${Names} of=${row.leads} />`],
      [t("daemon.stands-by"), row.stands_by.length > 0 && html`<${Names} of=${row.stands_by} />`],
      [t("daemon.uptime"), row.up_since && html`<${Since} at=${row.up_since} />`],
      [t("daemon.version"), row.version && html`<${Text} of=${row.version} />`],
      [t("daemon.certificate"), days !== null && days !== undefined && html`<span class=${days < CERTIFICATE_SOON ? "problem" : ""}>${t("daemon.days", { n: days })}</span>`],
      [t("daemon.memory"), row.memory_bytes && `${number(row.memory_bytes / 1048576, 0)} MiB`],
      [t("daemon.files"), row.open_files && `${number(row.open_files)} / ${number(row.open_files_max ?? 0)}`],
      [t("daemon.mailboxes"), mail && t("daemon.mail", { waiting: number(mail.waiting), max: number(mail.waiting_max), received: number(mail.received) })],
      [t("daemon.lost"), mail && mail.overflowed + mail.unreadable + mail.not_sent + mail.not_persisted > 0 && html`<span class="problem">${t("daemon.lost-counts", { overflowed: mail.overflowed, unreadable: mail.unreadable, unsent: mail.not_sent, unstored: mail.not_persisted })}</span>`],
      [t("daemon.rejected"), mail && Object.keys(mail.rejected).length > 0 && html`<span class="problem"><${Text} of=${Object.entries(mail.rejected).map(([rule, n]) => `${rule}: ${n}`).join(", ")} /></span>`],
    ].map(([name, value]) => [name, value === false ? null : value])} /></article>`;
}

function Names({ of }) {
  return html`<span>${of.slice(0, NAMED).map((name, at) => html`<span key=${name}>${at > 0 && ", "}<${Link} page="agents" name=${name} /></span>`)}${of.length > NAMED && ` +${of.length - NAMED}`}</span>`;
}
