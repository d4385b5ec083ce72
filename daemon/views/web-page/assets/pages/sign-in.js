// Sign-in. It is shown at the address that was asked for, so that one goes on there afterwards.

import { screenProblem, signIn } from "../lib/api.js";
import { html, useEffect, useId, useRef, useState } from "../lib/html.js";
import { t } from "../lib/language.js";
import { useFollowed } from "../lib/state.js";
import { Sign, Text } from "../lib/ui.js";

export function SignInPage() {
  const [name, setName] = useState("");
  const [password, setPassword] = useState("");
  const [problem, setProblem] = useState("");
  const [isBusy, setBusy] = useState(false);
  const ofScreen = useFollowed(screenProblem);
  const field = useRef(null);
  const id = useId();
  useEffect(() => { field.current?.focus(); }, []);
  const submit = async (event) => {
    event.preventDefault();
    setBusy(true);
    setProblem("");
    try {
      await signIn(name, password);
    } catch (why) {
      setProblem(why.message);
      setPassword("");
      setBusy(false);
    }
  };
  return html`<div class="sign-in"><h1>${t("sign-in.title")}</h1><p class="muted">${t("sign-in.about")}</p>
    ${ofScreen && html`<p class="problem" role="alert"><${Sign} of="bad" /> <${Text} of=${ofScreen} /></p>`}
    <form onSubmit=${submit}>
      <div class="field"><label for=${`${id}n`}>${t("sign-in.name")}</label><input id=${`${id}n`} ref=${field} name="username" autocomplete="username" autocapitalize="none" spellcheck="false" required value=${name} onInput=${(event) => setName(event.target.value)} /></div>
      <div class="field"><label for=${`${id}p`}>${t("sign-in.password")}</label><input id=${`${id}p`} type="password" name="password" autocomplete="current-password" required value=${password} onInput=${(event) => setPassword(event.target.value)} /></div>
      <button class="button primary large" disabled=${isBusy}>${isBusy ? t("sign-in.busy") : t("sign-in.do")}</button>
      <div role="alert" class="sign-in-problem">${problem && html`<p class="problem"><${Sign} of="bad" /> <${Text} of=${problem} /></p>`}</div>
    </form></div>`;
}
