//! A Chromium that is told what to do over pipes, by the DevTools protocol:
//! <https://chromedevtools.github.io/devtools-protocol/>. The end-to-end tests include this file, too.

#![allow(dead_code, reason = "each target of tests uses its part")]

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::left_out::left_out;

/// Time limit of everything that a test waits for: a browser that starts beside other tests.
const LIMIT: Duration = Duration::from_secs(40);

/// The same, for a script in the page, which then tells what it waits for.
const SCRIPT_LIMIT_MS: u64 = 30_000;

/// Frames for which an element stays where it is before it is clicked.
const STILL_FRAMES: u32 = 4;

/// Maximum number of clicks on an element that moves before each of them.
const CLICKS_MAX: u32 = 5;

/// One browser runs at a time: they would take the cores from each other.
static ONE: Mutex<()> = Mutex::new(());

/// Bytes that end a message of the protocol.
const END: u8 = 0;

/// A browser, and the tab that the methods are about.
pub(crate) struct Chromium {
    child: Child,
    input: ChildStdin,
    messages: Receiver<Value>,
    session: String,
    last_id: u64,
    /// Mistakes in the pages so far: exceptions, violations of the content security policy, dialogs.
    pub(crate) problems: Vec<String>,
    /// The registrations of service workers that the browser has told.
    workers: Vec<String>,
    _profile: TempDir,
    _one: MutexGuard<'static, ()>,
}

impl Chromium {
    /// Starts a browser. Without Chromium on this machine, the test is left out, and the result is
    /// `None`.
    pub(crate) fn start() -> Option<Chromium> {
        Chromium::start_at(None)
    }

    /// Starts a browser of a user with this home folder, in which it finds the authorities that the
    /// user trusts.
    pub(crate) fn start_at(home: Option<&Path>) -> Option<Chromium> {
        let one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        let profile = tempfile::tempdir().expect("a folder");
        // The protocol is spoken over the descriptors 3 and 4.
        let mut child = Command::new("sh")
            .args(["-c", "exec \"$@\" 3<&0 4>&1 0</dev/null 1>/dev/null 2>/dev/null", "sh"])
            .args(["chromium", "--headless=new", "--no-sandbox", "--remote-debugging-pipe"])
            .args(["--no-first-run", "--disable-gpu", "--disable-dev-shm-usage"])
            .args(["--disable-extensions", "--disable-background-networking", "--lang=en-US"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .envs(home.map(|home| ("HOME", home)))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("a shell");
        let (input, output) = (child.stdin.take().expect("piped"), child.stdout.take());
        let messages = read(output.expect("piped"));
        let mut browser = Chromium {
            child,
            input,
            messages,
            session: String::new(),
            last_id: 0,
            problems: Vec::new(),
            workers: Vec::new(),
            _profile: profile,
            _one: one,
        };
        let Ok(targets) = browser.try_call("Target.getTargets", json!({})) else {
            left_out("there is no `chromium`, as Debian's package of that name has it");
            return None;
        };
        let targets = targets["targetInfos"].as_array().expect("targets").clone();
        let page = targets.iter().find(|target| target["type"] == "page").expect("a tab");
        browser.attach(&page["targetId"]);
        Some(browser)
    }

    /// Makes a tab the one that the methods are about.
    fn attach(&mut self, target: &Value) {
        let attach = json!({ "targetId": target, "flatten": true });
        let attached = self.call("Target.attachToTarget", attach);
        self.session = attached["sessionId"].as_str().expect("a session").to_owned();
        for domain in ["Page", "Runtime", "Log", "Network"] {
            self.call(&format!("{domain}.enable"), json!({}));
        }
        // The events of the focus come also while the machine has no window in front.
        self.call("Emulation.setFocusEmulationEnabled", json!({ "enabled": true }));
        self.resize(1280, 860);
    }

    /// Opens a tab of another person, who has nothing of the first one's cookies, and makes it the
    /// one that the methods are about. Returns the tab of before.
    pub(crate) fn open_tab_of_another(&mut self) -> String {
        let context = self.call("Target.createBrowserContext", json!({}));
        let tab = json!({
            "url": "about:blank", "browserContextId": context["browserContextId"], "newWindow": true,
        });
        let tab = self.call("Target.createTarget", tab);
        let before = self.session.clone();
        self.attach(&tab["targetId"]);
        before
    }

    /// Makes this tab the one that the methods are about. Returns the tab of before.
    pub(crate) fn turn_to(&mut self, tab: String) -> String {
        std::mem::replace(&mut self.session, tab)
    }

    /// Calls a method of the protocol.
    #[track_caller]
    pub(crate) fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.try_call(method, parameters).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    fn try_call(&mut self, method: &str, parameters: Value) -> Result<Value, String> {
        self.last_id += 1;
        let mut command = json!({ "id": self.last_id, "method": method, "params": parameters });
        if !method.starts_with("Target.") && !method.starts_with("Browser.") {
            command["sessionId"] = json!(self.session);
        }
        let mut bytes = command.to_string().into_bytes();
        bytes.push(END);
        self.input.write_all(&bytes).map_err(|error| error.to_string())?;
        let until = Instant::now() + LIMIT;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let mut message =
                self.messages.recv_timeout(left).map_err(|error| error.to_string())?;
            if message["id"] != self.last_id {
                self.note(&message);
                continue;
            }
            return match message["error"]["message"].as_str() {
                Some(error) => Err(error.to_owned()),
                None => Ok(message["result"].take()),
            };
        }
    }

    /// Notes the mistakes that the browser tells.
    fn note(&mut self, message: &Value) {
        let parameters = &message["params"];
        if message["method"] == "ServiceWorker.workerRegistrationUpdated" {
            let told = parameters["registrations"].as_array().into_iter().flatten();
            let ids = told.filter_map(|one| one["registrationId"].as_str().map(str::to_owned));
            self.workers.extend(ids);
        }
        let text = match message["method"].as_str() {
            Some("Runtime.exceptionThrown") => &parameters["exceptionDetails"],
            Some("Page.javascriptDialogOpening") => &parameters["message"],
            Some("Log.entryAdded") if parameters["entry"]["source"] != "network" => {
                &parameters["entry"]["text"]
            }
            Some("Runtime.consoleAPICalled") if parameters["type"] == "error" => {
                &parameters["args"]
            }
            _ => return,
        };
        self.problems.push(text.to_string());
    }

    /// Returns the value of a script, which may be a promise; `Err` if it throws or its page is left
    /// meanwhile.
    pub(crate) fn try_evaluate(&mut self, script: &str) -> Result<Value, String> {
        let script = json!({ "expression": script, "awaitPromise": true, "returnByValue": true });
        let mut answer = self.try_call("Runtime.evaluate", script)?;
        let thrown = &answer["exceptionDetails"];
        if !thrown.is_null() {
            return Err(
                thrown["exception"]["description"].to_string() + &thrown["text"].to_string()
            );
        }
        Ok(answer["result"]["value"].take())
    }

    /// Returns the value of a script.
    #[track_caller]
    pub(crate) fn evaluate(&mut self, script: &str) -> Value {
        self.try_evaluate(script).unwrap_or_else(|error| panic!("{error} in {script}"))
    }

    /// Waits until a condition holds in the page. The page says when something has changed.
    #[track_caller]
    pub(crate) fn wait_for(&mut self, condition: &str) {
        if !self.holds_soon(condition) {
            let seen = self.try_evaluate("location.href + '\\n' + document.body.innerText");
            panic!("{condition} does not hold: {seen:?}, {:?}", self.problems);
        }
    }

    /// Waits until a condition holds in the page; returns `false` if it does not within the time
    /// limit.
    #[track_caller]
    pub(crate) fn holds_soon(&mut self, condition: &str) -> bool {
        let script = format!(
            "new Promise((done) => {{
                const holds = () => {{ try {{ return Boolean({condition}); }} catch {{ return false; }} }};
                if (holds()) return done(true);
                const end = (is) => {{ observer.disconnect(); clearInterval(again); clearTimeout(limit); done(is); }};
                const look = () => {{ if (holds()) end(true); }};
                const observer = new MutationObserver(look);
                observer.observe(document, {{ subtree: true, childList: true, attributes: true, characterData: true }});
                const again = setInterval(look, 100);
                const limit = setTimeout(() => end(false), {SCRIPT_LIMIT_MS});
            }})"
        );
        let until = Instant::now() + LIMIT;
        loop {
            match self.try_evaluate(&script) {
                Ok(held) => return held == true,
                // A page that is left takes its scripts along.
                Err(error) if Instant::now() < until && error.contains("navigat") => (),
                Err(error) => panic!("{condition}: {error}, {:?}", self.problems),
            }
        }
    }

    /// Opens an address and waits until its page is drawn.
    #[track_caller]
    pub(crate) fn open(&mut self, address: &str) {
        let navigated = self.call("Page.navigate", json!({ "url": address }));
        assert!(navigated["errorText"].is_null(), "{address}: {navigated}");
        self.wait_for("document.readyState === 'complete' && document.querySelector('h1')");
    }

    /// Opens a page and signs a person in there.
    #[track_caller]
    pub(crate) fn sign_in(&mut self, address: &str, name: &str, password: &str) {
        self.open(address);
        self.fill_in_sign_in(name, password);
    }

    /// Signs a person in on a page that asks for that.
    #[track_caller]
    pub(crate) fn fill_in_sign_in(&mut self, name: &str, password: &str) {
        self.wait_for("document.activeElement?.name === 'username'");
        self.type_text(name);
        self.press("Tab");
        self.type_text(password);
        self.press("Enter");
        self.wait_for("document.querySelector('.stop-button')");
    }

    /// Chooses an option of the first `select` of a selector that has it.
    #[track_caller]
    pub(crate) fn choose(&mut self, selector: &str, option: &str) {
        let find = format!(
            "[...document.querySelectorAll({selector:?})].find((one) => [...one.options].some((option) => option.value === {option:?}))"
        );
        self.wait_for(&find);
        self.evaluate(&format!(
            "(() => {{ const select = {find}; select.value = {option:?}; select.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()"
        ));
    }

    /// Returns the texts of all elements of a selector.
    #[track_caller]
    pub(crate) fn texts(&mut self, selector: &str) -> Vec<String> {
        let texts = self.evaluate(&format!(
            "[...document.querySelectorAll({selector:?})].map((one) => one.innerText)"
        ));
        let texts = texts.as_array().into_iter().flatten();
        texts.filter_map(|text| text.as_str().map(str::to_owned)).collect()
    }

    /// Sets the size of the page.
    pub(crate) fn resize(&mut self, width: u32, height: u32) {
        let size = json!({
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false,
        });
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// Makes the browser prefer dark or light pages.
    pub(crate) fn prefer(&mut self, scheme: &str) {
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Lets the pages of an origin do something that a person decides, or keeps it from them.
    pub(crate) fn permit(&mut self, origin: &str, name: &str, setting: &str) {
        let permission =
            json!({ "permission": { "name": name }, "setting": setting, "origin": origin });
        self.call("Browser.setPermission", permission);
    }

    /// Returns the registration of the newest service worker; waits until the browser tells it.
    #[track_caller]
    pub(crate) fn service_worker(&mut self) -> String {
        let until = Instant::now() + LIMIT;
        while self.workers.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            let message = self.messages.recv_timeout(left).expect("a service worker");
            self.note(&message);
        }
        self.workers.last().cloned().expect("it is told")
    }

    /// Presses and releases a key.
    pub(crate) fn press(&mut self, key: &str) {
        let (code, text) = match key {
            "Tab" => (9, ""),
            "Enter" => (13, "\r"),
            "Escape" => (27, ""),
            " " => (32, " "),
            "ArrowRight" => (39, ""),
            "ArrowDown" => (40, ""),
            other => panic!("the key {other} is not known here"),
        };
        let name = if key == " " { "Space" } else { key };
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({
                "type": kind, "key": key, "code": name, "windowsVirtualKeyCode": code,
            });
            if kind == "keyDown" && !text.is_empty() {
                event["text"] = json!(text);
            }
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Types a text where the focus is.
    pub(crate) fn type_text(&mut self, text: &str) {
        self.call("Input.insertText", json!({ "text": text }));
    }

    /// Clicks the first element of a selector, with a text if one is given, as a finger does. A page
    /// may move the element after all, so the click is repeated if something else was hit.
    #[track_caller]
    pub(crate) fn click(&mut self, selector: &str, text: &str) {
        let is_meant = format!("one.innerText.includes({text:?}) && !one.disabled");
        let find =
            format!("[...document.querySelectorAll({selector:?})].find((one) => {is_meant})");
        for _ in 0..CLICKS_MAX {
            self.wait_for(&find);
            let at = self.place_of(&find);
            self.evaluate(&format!(
                "(() => {{
                    window.isHit = false;
                    document.addEventListener('click', (event) => {{
                        const one = event.target.closest({selector:?});
                        window.isHit = Boolean(one && {is_meant});
                    }}, {{ capture: true, once: true }});
                }})()"
            ));
            for kind in ["mousePressed", "mouseReleased"] {
                let event = json!({
                    "type": kind, "x": at[0], "y": at[1], "button": "left", "clickCount": 1,
                });
                self.call("Input.dispatchMouseEvent", event);
            }
            // After a link to another document, the window is a new one.
            if self.evaluate("window.isHit ?? true") != json!(false) {
                return;
            }
        }
        panic!("{selector} {text:?} moves before each click");
    }

    /// Returns the middle of the element that a script finds. A page that is being filled moves what is
    /// on it: the place is taken when it stays for some frames.
    #[track_caller]
    fn place_of(&mut self, find: &str) -> Value {
        self.evaluate(&format!(
            "new Promise((done) => {{
                let before = '', same = 0;
                const look = () => {{
                    const found = {find};
                    found?.scrollIntoView({{ block: 'center', behavior: 'instant' }});
                    const box = found?.getBoundingClientRect();
                    const now = JSON.stringify(box);
                    same = box && now === before ? same + 1 : 0;
                    before = now;
                    if (same < {STILL_FRAMES}) return requestAnimationFrame(look);
                    done([box.x + box.width / 2, box.y + box.height / 2]);
                }};
                look();
            }})"
        ))
    }

    /// Makes sure that the pages have made no mistake so far.
    #[track_caller]
    pub(crate) fn assert_no_problems(&mut self) {
        self.evaluate("1");
        assert!(self.problems.is_empty(), "{:#?}", self.problems);
    }

    /// Writes what the tab shows into `folder`, if the environment names one for pictures.
    pub(crate) fn picture(&mut self, name: &str) {
        let Some(folder) = std::env::var_os("ALTHING_PICTURES") else { return };
        let taken = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        let data = taken["data"].as_str().expect("a picture");
        let bytes = BASE64_STANDARD.decode(data).expect("base64");
        let file = std::path::Path::new(&folder).join(format!("{name}.png"));
        std::fs::write(file, bytes).expect("a folder for pictures");
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Reads the messages of the browser until it ends.
fn read(output: ChildStdout) -> Receiver<Value> {
    let (send, messages) = channel();
    std::thread::spawn(move || {
        let mut output = BufReader::new(output);
        let mut bytes = Vec::new();
        while output.read_until(END, &mut bytes).is_ok_and(|read| read > 0) {
            let text = bytes.strip_suffix(&[END]).unwrap_or(&bytes);
            let Ok(message) = serde_json::from_slice(text) else { break };
            if send.send(message).is_err() {
                break;
            }
            bytes.clear();
        }
    });
    messages
}
