// The person who is signed in, and what she may; and the log of who asked for what, if the daemon
// shows it.

import { get, me } from "../lib/api.js";
import { html, useEffect, useState } from "../lib/html.js";
import { t, tOr } from "../lib/language.js";
import { At } from "../lib/time.js";
import { pushOff, pushOn, pushState } from "../lib/push.js";
import { useFollowed } from "../lib/state.js";
import { SmallTable } from "../lib/table.js";
import { Card, PageHead, Sign, SignOut, Text } from "../lib/ui.js";

const RIGHTS = ["look", "ask", "change", "admit", "stop", "secrets"];

export function PeoplePage() {
  const person = useFollowed(me);
  const [log, setLog] = useState(undefined);
  useEffect(() => {
    let isThere = true;
    get("/api/log").then((found) => isThere && setLog(found), () => isThere && setLog(null));
    return () => { isThere = false; };
  }, []);
  const entries = log?.requests ?? null;
  return html`<${PageHead} title=${t("people.title")} about=${t("people.about")}>
      <${SignOut} label=${t("people.sign-out")} /><//>
    <${Card} title=${html`<${Text} of=${person.person} />`}><ul class="plain">${RIGHTS.map((right) => {
      const has = person.rights.includes(right);
      return html`<li key=${right}><${Sign} of=${has ? "well" : "info"} /> <strong>${t(`right.${right}`)}</strong> <span class="muted">${has ? t(`right.${right}-about`) : t("right.none")}</span></li>`;
    })}</ul><p class="muted">${t("people.where", { ecosystem: person.ecosystem, daemon: person.daemon })}</p><//>
    <${Notifications} />
    <${Card} title=${t("people.log")}>${log === undefined ? html`<p class="empty">${t("empty.loading")}</p>`
      : entries === null ? html`<p class="empty">${t("people.no-log")}</p>`
      : html`<${SmallTable} label=${t("people.log")} head=${[t("people.at"), t("people.person"), t("people.from"), t("people.what"), t("people.outcome")]}
          rows=${entries.slice(-200).reverse().map((entry) => [html`<${At} at=${momentOf(entry.at)} />`, html`<${Text} of=${entry.person ?? ""} />`, html`<${Text} of=${entry.from} />`, html`<${Text} of=${entry.what} />`, html`<${Text} of=${tOr(`outcome.${entry.outcome}`, entry.outcome)} />`])} />`}<//>`;
}

// Switches notifications on this device on and off.
function Notifications() {
  const [state, setState] = useState(null);
  const [problem, setProblem] = useState("");
  const look = () => pushState().then(setState, () => setState({ can: false, why: "push.failed" }));
  useEffect(() => { look(); }, []);
  const change = async (what) => {
    setProblem("");
    try {
      await what();
    } catch (why) {
      setProblem(tOr(why.message, why.message));
    }
    await look();
  };
  return html`<${Card} title=${t("push.title")}><p class="muted">${state === null ? t("empty.loading") : state.can ? t("push.about") : t(state.why)}</p>
    ${state?.can && html`<p><button type="button" class="button push-button" onClick=${() => change(() => (state.isOn ? pushOff() : pushOn(state.key)))}>${state.isOn ? t("push.off") : t("push.on")}</button></p>`}
    <p role="status" class="problem push-problem"><${Text} of=${problem} /></p><//>`;
}

// A moment of the log: milliseconds, or a text.
function momentOf(at) {
  const found = typeof at === "number" ? at : Date.parse(at);
  return Number.isFinite(found) ? found : null;
}
