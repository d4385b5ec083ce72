//! The robot's on-board screen, where a person logs in (the paper, “Scenario 3”).
//!
//! - The method that validates a person puts a `query-ref` to all keyboards, each time with a
//!   deadline, and holds the answer against the PIN of the config.
//! - Who answers first is heard; a wrong answer is asked for again, a few times. Then the screen
//!   is locked for a while, whoever asks. Where nobody answers, nobody is asked again for as long
//!   as an answer was waited for.
//! - **Invariant:** neither the PIN nor an answer is in a log, a report or a `Debug` of this file.
//!
//! Asking is the actuator's: the method says what is to be asked, `Device::watch` asks it, and
//! `Device::heard` brings the answer back.

use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use acl::content::Question;
use actuator::{BoxFuture, Failure, Initiative, News};
use agent::{Blueprint, BuildError, Rehearsal};
use serde::Deserialize;
use tokio::sync::{Mutex, mpsc};
use tokio::time::Instant;

/// The name of the question among the robot's initiatives.
pub(crate) const LOGIN: &str = "login";

/// The method that lets a person log in.
pub(crate) const METHOD: &str = "log_in";

/// How long the screen is locked after as many wrong answers as it takes: trying all PINs of four
/// digits by threes takes eleven days.
const LOCKED_FOR: Duration = Duration::from_secs(5 * 60);

/// What is to be asked.
enum Asking {
    This(String),
    /// Nothing any more: nobody waits for the answer.
    Nothing,
}

/// How many questions may wait to be asked, and answers to be read. There is one of each.
const WAITING_MAX: usize = 4;

/// What `login` in an entry's `config` says.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct LoginConfig {
    /// What a person has to answer.
    #[serde(default)]
    pin: Option<String>,
    /// The file whose first line that is, so that it need not stand in the ecosystem file.
    #[serde(default)]
    pin_file: Option<PathBuf>,
    /// How long one answer is waited for.
    #[serde(default = "default_patience")]
    patience: String,
    /// How many answers may be wrong.
    #[serde(default = "default_attempts")]
    attempts: u32,
    /// How long a person who logged in counts as validated.
    #[serde(default = "default_valid_for")]
    valid_for: String,
}

fn default_patience() -> String {
    "60s".to_owned()
}

fn default_attempts() -> u32 {
    3
}

fn default_valid_for() -> String {
    "10m".to_owned()
}

/// A PIN that nobody prints.
#[derive(Clone)]
struct Secret(Arc<str>);

impl Secret {
    /// Compares without stopping at the first difference, so that time tells nothing.
    fn is(&self, answer: &str) -> bool {
        let (expected, given) = (self.0.as_bytes(), answer.trim().as_bytes());
        let differs = |(expected, given): (&u8, &u8)| expected ^ given;
        let difference = expected.iter().zip(given).map(differs).fold(0, |all, one| all | one);
        expected.len() == given.len() && difference == 0
    }
}

/// Reads a file with a PIN, unless every user of the machine could read it, or its group change it.
///
/// A group may read it: that is how systemd hands a credential to a service, and how an administrator
/// lets a daemon read what root owns.
fn read_pin(path: &Path) -> Result<String, String> {
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    let mode = file.metadata().map_err(|error| error.to_string())?.mode() & 0o777;
    if mode & 0o027 != 0 {
        let path = path.display();
        return Err(format!(
            "others can read or change it (mode {mode:03o}); close it with `chmod 600 {path}`"
        ));
    }
    let mut text = String::new();
    file.read_to_string(&mut text).map_err(|error| error.to_string())?;
    Ok(text)
}

/// Until when the screen is locked: shared with the attempt that may lock it.
type Lock = Arc<std::sync::Mutex<Option<Instant>>>;

/// The on-board screen.
pub(crate) struct Login {
    secret: Secret,
    patience: Duration,
    attempts: u32,
    pub(crate) valid_for: Duration,
    lock: Lock,
    ask: mpsc::Sender<Asking>,
    asked: Arc<Mutex<mpsc::Receiver<Asking>>>,
    /// Where the person's answer is waited for, while it is.
    answers: Option<mpsc::Sender<News>>,
}

impl Login {
    pub(crate) fn new(blueprint: &Blueprint, config: LoginConfig) -> Result<Login, BuildError> {
        let LoginConfig { pin, pin_file, patience, attempts, valid_for } = config;
        let problem = |text: String| blueprint.problem(text);
        let is_rehearsal = blueprint.host.resources.get::<Rehearsal>().is_some();
        let secret = match (pin, pin_file) {
            (Some(pin), None) => pin,
            // It is on the robot's own machine.
            (None, Some(file)) if is_rehearsal => file.display().to_string(),
            (None, Some(file)) => {
                let text = read_pin(&file);
                let text =
                    text.map_err(|why| problem(format!("read {}: {why}", file.display())))?;
                text.lines().next().unwrap_or_default().to_owned()
            }
            _ => return Err(problem("`login` needs `pin` or `pin-file`, one of them".to_owned())),
        };
        let secret = secret.trim();
        if secret.is_empty() || attempts == 0 {
            return Err(problem("`login` needs a PIN that is not empty, and attempts".to_owned()));
        }
        let duration = |text: &str| {
            humantime::parse_duration(text).map_err(|error| problem(format!("`{text}`: {error}")))
        };
        let (ask, asked) = mpsc::channel(WAITING_MAX);
        Ok(Login {
            secret: Secret(Arc::from(secret)),
            patience: duration(&patience)?,
            attempts,
            valid_for: duration(&valid_for)?,
            lock: Lock::default(),
            ask,
            asked: Arc::new(Mutex::new(asked)),
            answers: None,
        })
    }

    /// Whether anybody can try to log in now.
    pub(crate) fn is_open(&self) -> bool {
        let until = *self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        until.is_none_or(|until| until <= Instant::now())
    }

    /// The longest that logging in may take.
    pub(crate) fn timeout(&self) -> Duration {
        (self.patience + Duration::from_secs(2)) * self.attempts
    }

    /// Lets a person log in at `place`.
    pub(crate) fn log_in(&mut self, place: String) -> BoxFuture<Result<String, Failure>> {
        let (answer, answers) = mpsc::channel(WAITING_MAX);
        self.answers = Some(answer);
        let attempt = Attempt {
            secret: self.secret.clone(),
            lock: Arc::clone(&self.lock),
            rest: self.patience,
            ask: self.ask.clone(),
            answers,
            is_open: false,
            attempts: self.attempts,
            place,
        };
        Box::pin(attempt.run())
    }

    /// Waits until something is to be asked; what the robot then does.
    pub(crate) fn next_question(&self) -> BoxFuture<Vec<Initiative>> {
        let (asked, patience) = (Arc::clone(&self.asked), self.patience);
        Box::pin(async move {
            match asked.lock().await.recv().await {
                Some(Asking::Nothing) => vec![Initiative::Withdraw { name: LOGIN.to_owned() }],
                Some(Asking::This(text)) => {
                    let (name, question) = (LOGIN.to_owned(), Question::new(text));
                    vec![Initiative::Ask { name, question, patience }]
                }
                // The robot is gone, and this with it.
                None => std::future::pending().await,
            }
        })
    }

    /// Passes on what a person answered.
    pub(crate) fn heard(&mut self, news: &News) {
        // Nobody waits any more, or there is an answer already: the first counts.
        let is_lost = |answers: &mpsc::Sender<News>| answers.try_send(news.clone()).is_err();
        if self.answers.as_ref().is_some_and(is_lost) {
            self.answers = None;
        }
    }
}

/// One person's way in.
struct Attempt {
    secret: Secret,
    lock: Lock,
    /// How long nobody is asked again where nobody answered.
    rest: Duration,
    ask: mpsc::Sender<Asking>,
    answers: mpsc::Receiver<News>,
    /// Whether an answer is waited for.
    is_open: bool,
    attempts: u32,
    place: String,
}

impl Attempt {
    async fn run(mut self) -> Result<String, Failure> {
        let failed = |why: &str| Failure::Driver(why.to_owned());
        for attempt in 1..=self.attempts {
            let again = if attempt == 1 { "" } else { "That was wrong. " };
            let text = format!("{again}Who is at {}? Log in with your PIN.", self.place);
            let asked = self.ask.send(Asking::This(text)).await;
            asked.map_err(|_| failed("ask anybody: the screen is off"))?;
            self.is_open = true;
            let answer = self.answers.recv().await;
            self.is_open = false;
            match answer {
                Some(News::Answer(answer)) if self.secret.is(&answer) => {
                    return Ok(self.place.clone());
                }
                Some(News::Answer(_)) => (),
                Some(News::Refused(refusal)) => {
                    self.close_for(self.rest);
                    return Err(failed(&format!("validate anybody: {}", refusal.detail)));
                }
                Some(News::Unanswered(why)) => {
                    self.close_for(self.rest);
                    return Err(failed(&format!("validate anybody: {why}")));
                }
                Some(News::Report(_)) | None => return Err(failed("hear anybody")),
            }
        }
        self.close_for(LOCKED_FOR);
        Err(failed(&format!("validate anybody: {} answers were wrong", self.attempts)))
    }

    fn close_for(&self, time: Duration) {
        let until = Instant::now() + time;
        *self.lock.lock().unwrap_or_else(PoisonError::into_inner) = Some(until);
    }
}

impl Drop for Attempt {
    fn drop(&mut self) {
        // It was given up: a person need not go to the keyboard for it. If there is no room, the
        // question ends at its deadline.
        if self.is_open {
            let _ = self.ask.try_send(Asking::Nothing);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_pin_that_every_user_can_read_is_refused_with_the_cure() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("pin");
        fs::write(&path, "4711\n").expect("it is written");
        for (mode, is_fine) in [
            (0o600, true),
            (0o400, true),
            (0o440, true),
            (0o644, false),
            (0o604, false),
            (0o620, false),
        ] {
            fs::set_permissions(&path, Permissions::from_mode(mode)).expect("ours");
            let read = read_pin(&path);
            assert_eq!(read.is_ok(), is_fine, "{mode:o}: {read:?}");
            if let Err(why) = read {
                assert!(why.contains(&format!("chmod 600 {}", path.display())), "{why}");
                assert!(!why.contains("4711"), "{why}");
            }
        }
    }
}
