//! Controls a Chromium by its DevTools protocol:
//! <https://chromedevtools.github.io/devtools-protocol/>.
//!
//! - One tab is used, the first that the browser has. If another tab hides it,
//!   [`PageState::is_visible`] is `false`.
//! - Dialogs of a page (`alert`) would stop the page and every answer from it, so they are closed.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::net::UnixStream;
use tokio::time::Instant;

use crate::frames::Frames;
use crate::{ScreenLinkError, limited};

/// Time limit for a browser to start. It is that of a small board that reads the program from a
/// slow disk.
const STARTING: Duration = Duration::from_secs(30);

/// Time limit of a command that the browser answers without a network. A page whose script never
/// ends does not answer at all.
const ANSWERING: Duration = Duration::from_secs(3);

/// Time limit for a server to answer with a page.
const NAVIGATING: Duration = Duration::from_secs(12);

/// Time limit for the parts of a page to arrive after the page itself. After this time, a page
/// counts as shown if it can be seen, because some pages never stop loading.
const LOADING: Duration = Duration::from_secs(5);

/// Pause before a page that has not answered is asked again. People do not notice the pause.
const LOOKING_AGAIN: Duration = Duration::from_millis(50);

/// Script that describes the page in the tab.
const LOOK: &str = "(() => {
    const navigation = performance.getEntriesByType('navigation')[0];
    const only = document.body && document.body.children.length === 1 && document.body.children[0];
    const film = only && only.tagName === 'VIDEO' ? only : null;
    const picture = only && only.tagName === 'IMG' ? only : null;
    return {
        url: location.href,
        ready: document.readyState,
        visible: document.visibilityState === 'visible' && innerWidth > 0 && innerHeight > 0,
        status: (navigation && navigation.responseStatus) || 0,
        picture: picture && (!picture.complete || picture.naturalWidth > 0),
        film: film && {
            error: film.error && (film.error.message || 'code ' + film.error.code),
            ready: film.readyState,
            moves: !film.paused && !film.ended,
        },
    };
})()";

/// Script that waits until the film of the page, if there is one, has a picture or an error.
const SETTLED: &str = "new Promise(done => {
    const only = document.body && document.body.children.length === 1 && document.body.children[0];
    const film = only && only.tagName === 'VIDEO' ? only : null;
    if (!film || film.error || film.readyState >= 2) return done(true);
    film.addEventListener('loadeddata', () => done(true));
    film.addEventListener('error', () => done(true), true);
})";

/// The connection to a browser, and the session with its tab.
#[derive(Debug)]
pub struct Browser {
    frames: Frames,
    target: String,
    session: String,
    last_id: u64,
    /// Whether the requested page has replaced the one before.
    has_arrived: bool,
    /// Whether the load event of the requested page has arrived.
    is_loaded: bool,
    is_crashed: bool,
}

/// State of the page in the tab, as a script in the page reports it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PageState {
    /// Address of the page.
    pub url: String,
    /// Whether the browser has parsed the page, so that it can be seen.
    pub is_readable: bool,
    /// Whether the tab is in front and its window has a size.
    pub is_visible: bool,
    /// HTTP status of the page; `None` if it has none.
    pub status: Option<u16>,
    /// For a page that consists of one picture: whether the picture can be seen. `None` for any
    /// other page.
    pub picture: Option<bool>,
    /// For a page that consists of one film: the state of the film. `None` for any other page.
    pub film: Option<FilmState>,
}

/// State of a film in a page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FilmState {
    /// Reason why the film cannot be played; `None` if it can.
    pub error: Option<String>,
    /// Whether the film has a picture to show.
    pub has_picture: bool,
    /// Whether the film is neither paused nor at its end.
    pub is_moving: bool,
}

impl Browser {
    /// Attaches to the first tab of the browser at the other end of `stream`.
    ///
    /// # Errors
    ///
    /// Returns an error if the browser does not start in time or has no tab.
    pub async fn attach(stream: UnixStream) -> Result<Browser, ScreenLinkError> {
        let mut browser = Browser {
            frames: Frames::new(stream, 0),
            target: String::new(),
            session: String::new(),
            last_id: 0,
            has_arrived: false,
            is_loaded: false,
            is_crashed: false,
        };
        limited("start the browser", STARTING, browser.attach_to_tab()).await?;
        Ok(browser)
    }

    async fn attach_to_tab(&mut self) -> Result<(), ScreenLinkError> {
        self.call("Target.setDiscoverTargets", json!({ "discover": true })).await?;
        loop {
            let targets = self.call("Target.getTargets", json!({})).await?;
            let targets = targets["targetInfos"].as_array().cloned().unwrap_or_default();
            let page = targets.iter().find(|target| target["type"] == "page");
            if let Some(id) = page.and_then(|page| page["targetId"].as_str()) {
                self.target = id.to_owned();
                break;
            }
            // The tab is announced as soon as it exists.
            self.handle_next_event().await?;
        }
        let attach = json!({ "targetId": self.target, "flatten": true });
        let attached = self.call("Target.attachToTarget", attach).await?;
        let session = attached["sessionId"].as_str().map(str::to_owned);
        self.session = session.ok_or_else(|| {
            ScreenLinkError::declined("attach to the tab of the browser", "it names no session")
        })?;
        // Otherwise the browser would store a file that it cannot show, and hide a part of the page
        // with a message about it.
        let no_downloads = json!({ "behavior": "deny" });
        self.call("Browser.setDownloadBehavior", no_downloads).await?;
        self.call("Inspector.enable", json!({})).await?;
        self.call("Page.enable", json!({})).await?;
        Ok(())
    }

    /// Makes the window as large as the screen. Without a window manager to do this, a browser
    /// leaves a margin.
    ///
    /// # Errors
    ///
    /// Returns an error if the browser does not answer.
    pub async fn fill_screen(&mut self) -> Result<(), ScreenLinkError> {
        let sizes = "[innerWidth, innerHeight, screen.width, screen.height]";
        let sizes = self.evaluate(sizes).await?;
        let size = |index: usize| sizes[index].as_u64().unwrap_or(0);
        if size(0) >= size(2) && size(1) >= size(3) {
            return Ok(());
        }
        let window = json!({ "targetId": self.target });
        let window = self.quick("Browser.getWindowForTarget", window).await?;
        let id = window["windowId"].clone();
        let bounds = json!({ "left": 0, "top": 0, "width": size(2), "height": size(3) });
        // A window in the state of full screen has to leave it before it gets a size.
        let states = ["normal", "fullscreen"].map(|state| json!({ "windowState": state }));
        let [normal, fullscreen] = states;
        for bounds in [normal, bounds, fullscreen] {
            let set = json!({ "windowId": id, "bounds": bounds });
            self.quick("Browser.setWindowBounds", set).await?;
        }
        Ok(())
    }

    /// Shows the page at the address `url`, and returns it when it can be seen.
    ///
    /// # Errors
    ///
    /// Returns [`ScreenLinkError::Declined`] if the page cannot be loaded or is an error of its
    /// server, and another error if the browser does not answer.
    pub async fn open(&mut self, url: &str) -> Result<PageState, ScreenLinkError> {
        let what = format!("load {}", crate::shortened(url));
        (self.has_arrived, self.is_loaded) = (false, false);
        let call = self.call("Page.navigate", json!({ "url": url }));
        let navigated = match limited(&what, NAVIGATING, call).await {
            Err(ScreenLinkError::TimedOut { .. }) => {
                let why = format!("there was no answer within {NAVIGATING:?}");
                return Err(ScreenLinkError::declined(what, why));
            }
            navigated => navigated?,
        };
        if navigated["isDownload"] == true {
            return Err(ScreenLinkError::declined(
                what,
                "it is a file that the browser cannot show",
            ));
        }
        if let Some(why) = navigated["errorText"].as_str() {
            return Err(ScreenLinkError::declined(what, why));
        }
        // The page is there already, and only the part after `#` differs.
        self.is_loaded |= navigated["loaderId"].is_null();
        match limited(&what, LOADING, self.loaded()).await {
            Err(ScreenLinkError::TimedOut { .. }) | Ok(()) => (),
            Err(error) => return Err(error),
        }
        let page = self.look_at_arrived().await?;
        match page.problem() {
            Some(why) => Err(ScreenLinkError::declined(what, why)),
            None => Ok(page),
        }
    }

    /// Returns the page in the tab. A page that redirects the browser as soon as it is loaded has
    /// no answer for a moment, so the query is repeated for at most [`LOADING`].
    async fn look_at_arrived(&mut self) -> Result<PageState, ScreenLinkError> {
        let until = Instant::now() + LOADING;
        loop {
            let looked = self.look().await;
            let is_final = match &looked {
                Ok(page) => page.is_readable,
                Err(error) => !error.is_of_command(),
            };
            if is_final || Instant::now() >= until {
                return looked;
            }
            tokio::time::sleep(LOOKING_AGAIN).await;
        }
    }

    /// Waits until the present page and its film are loaded.
    async fn loaded(&mut self) -> Result<(), ScreenLinkError> {
        while !self.is_loaded {
            self.handle_next_event().await?;
        }
        let settled = json!({ "expression": SETTLED, "awaitPromise": true, "returnByValue": true });
        self.call("Runtime.evaluate", settled).await?;
        Ok(())
    }

    /// Returns the page that the tab shows now.
    ///
    /// # Errors
    ///
    /// Returns an error if the tab does not answer: it has crashed, or its script never ends.
    pub async fn look(&mut self) -> Result<PageState, ScreenLinkError> {
        let page = self.evaluate(LOOK).await?;
        let film = |film: &Value| FilmState {
            error: film["error"].as_str().map(crate::shortened),
            has_picture: film["ready"].as_u64().is_some_and(|ready| ready >= 2),
            is_moving: film["moves"] == true,
        };
        let status = page["status"].as_u64().and_then(|status| u16::try_from(status).ok());
        Ok(PageState {
            url: page["url"].as_str().unwrap_or_default().to_owned(),
            is_readable: page["ready"] != "loading",
            is_visible: page["visible"] == true,
            status: status.filter(|status| *status != 0),
            picture: page["picture"].as_bool(),
            film: Some(&page["film"]).filter(|found| found.is_object()).map(film),
        })
    }

    /// Waits until the browser closes the connection or its tab crashes, and returns that error.
    /// Events that arrive meanwhile are handled.
    pub async fn failed(&mut self) -> ScreenLinkError {
        loop {
            if let Err(error) = self.handle_next_event().await {
                return error;
            }
        }
    }

    async fn evaluate(&mut self, script: &str) -> Result<Value, ScreenLinkError> {
        let script = json!({ "expression": script, "returnByValue": true });
        let evaluated = self.quick("Runtime.evaluate", script).await?;
        if let Some(why) = evaluated["exceptionDetails"]["text"].as_str() {
            return Err(ScreenLinkError::declined("look at the page", why));
        }
        Ok(evaluated["result"]["value"].clone())
    }

    async fn quick(&mut self, method: &str, parameters: Value) -> Result<Value, ScreenLinkError> {
        let what = format!("have the answer of the page to `{method}`");
        limited(&what, ANSWERING, self.call(method, parameters)).await
    }

    /// Sends a command and returns its result. Events that arrive before the result are handled.
    async fn call(&mut self, method: &str, parameters: Value) -> Result<Value, ScreenLinkError> {
        let id = self.send(method, parameters).await?;
        loop {
            let mut message = self.next().await?;
            if message["id"] != id {
                continue;
            }
            if let Some(why) = message["error"]["message"].as_str() {
                return Err(ScreenLinkError::declined(
                    format!("do `{method}` in the browser"),
                    why,
                ));
            }
            return Ok(message["result"].take());
        }
    }

    async fn send(&mut self, method: &str, parameters: Value) -> Result<u64, ScreenLinkError> {
        self.last_id += 1;
        let mut command = json!({ "id": self.last_id, "method": method, "params": parameters });
        let is_of_browser = method.starts_with("Target.") || method.starts_with("Browser.");
        if !is_of_browser {
            command["sessionId"] = json!(self.session);
        }
        self.frames.send(&command).await?;
        Ok(self.last_id)
    }

    async fn handle_next_event(&mut self) -> Result<(), ScreenLinkError> {
        self.next().await.map(drop)
    }

    /// Returns the next message. If it is an event, the event is handled first.
    async fn next(&mut self) -> Result<Value, ScreenLinkError> {
        if self.is_crashed {
            return Err(ScreenLinkError::Crashed);
        }
        let message = self.frames.next().await?;
        let parameters = &message["params"];
        match message["method"].as_str() {
            Some("Inspector.targetCrashed") => self.is_crashed = true,
            Some("Target.targetCrashed" | "Target.targetDestroyed")
                if parameters["targetId"] == self.target.as_str() =>
            {
                self.is_crashed = true;
            }
            Some("Page.frameNavigated") if parameters["frame"]["parentId"].is_null() => {
                self.has_arrived = true;
            }
            Some("Page.loadEventFired") => self.is_loaded |= self.has_arrived,
            Some("Page.javascriptDialogOpening") => {
                // To refuse the dialog before a page is left means to stay there.
                let close = json!({ "accept": parameters["type"] == "beforeunload" });
                self.send("Page.handleJavaScriptDialog", close).await?;
            }
            _ => (),
        }
        if self.is_crashed { Err(ScreenLinkError::Crashed) } else { Ok(message) }
    }
}

impl PageState {
    /// Returns the reason why people do not see the content of the page; `None` if they see it.
    pub fn problem(&self) -> Option<String> {
        let PageState { url, is_readable, is_visible, status, picture, film } = self;
        if url.starts_with("chrome-error:") {
            return Some("the browser shows an error in its place".to_owned());
        }
        if let Some(status) = status.filter(|status| *status >= 400) {
            return Some(format!("its server answers with HTTP status {status}"));
        }
        if !is_readable {
            return Some(format!("it did not arrive within {LOADING:?}"));
        }
        if !is_visible {
            return Some("something else is in front of it".to_owned());
        }
        if *picture == Some(false) {
            return Some("it is not a picture that the browser can show".to_owned());
        }
        None.or_else(|| film.as_ref()?.error.as_ref().map(|why| format!("its film: {why}")))
    }
}
