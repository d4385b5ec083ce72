// What happened over days, as the history agent keeps it.

import { get } from "../lib/api.js";
import { html, useId, useState, useEffect } from "../lib/html.js";
import { t } from "../lib/language.js";
import { keep, place } from "../lib/router.js";
import { At } from "../lib/time.js";
import { SmallTable } from "../lib/table.js";
import { Link, PageHead, Text } from "../lib/ui.js";

const ROWS = 200;

export function HistoryPage() {
  const [about, setAbout] = useState(place.value.query.get("about") ?? "");
  const [found, setFound] = useState(undefined);
  const [problem, setProblem] = useState("");
  const id = useId();
  const look = async () => {
    const query = new URLSearchParams({ limit: String(ROWS) });
    if (about) query.set("about", about);
    setProblem("");
    keep("about", about);
    try {
      setFound((await get(`/api/history?${query}`)).events ?? []);
    } catch (why) {
      setFound(null);
      setProblem(why.message);
    }
  };
  useEffect(() => { look(); }, []);
  return html`<${PageHead} title=${t("nav.history")} about=${t("history.about")} />
    <form class="inline-form" role="search" onSubmit=${(event) => { event.preventDefault(); look(); }}><label for=${id}>${t("history.of")}</label>
      <input id=${id} type="search" value=${about} autocomplete="off" spellcheck="false" onInput=${(event) => setAbout(event.target.value)} /><button class="button">${t("history.look")}</button></form>
    <div role="status">${found === undefined && html`<p class="empty">${t("empty.loading")}</p>`}${problem && html`<p class="empty"><${Text} of=${problem} /></p>`}</div>
    ${found && html`<${SmallTable} label=${t("nav.history")} head=${[t("people.at"), t("history.what"), t("history.kind"), t("agent.agent")]} empty=${t("empty.history")}
      rows=${found.map((event) => [html`<${At} at=${event.at} />`,
        event.conversation ? html`<${Link} page="conversations" name=${event.conversation}><${Text} of=${event.text} /><//>` : html`<${Text} of=${event.text} />`,
        html`<span class="muted"><${Text} of=${event.kind} />${event.private && html` · ${t("history.private")}`}</span>`, event.agent && html`<${Link} page="agents" name=${event.agent} />`])} />`}`;
}
