//! The login of a person at the robot's on-board screen (the paper, “Scenario 3”).
//!
//! - The method that validates a person sends a `query-ref` with a deadline to all keyboards, and
//!   compares the answer with the PIN from the config.
//! - The first answer counts. After a wrong answer the question is sent again, up to the number of
//!   attempts. After the last wrong answer the screen is locked for a while, for all people. If no
//!   answer comes, the screen is locked for the time `patience`.
//! - **Invariant:** neither the PIN nor an answer is in a log, a report or a `Debug` output of this
//!   file.
//!
//! The method passes the text of the question to `Device::next_event`, which makes the actuator
//! send the question. `Device::receive_news` passes the answer back to the method.

use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use acl::content::Question;
use actuator::{BoxFuture, Initiative, InitiativeUpdate, MethodFailure};
use agent::{Blueprint, BuildCheck, BuildError, config_duration, config_tables};
use serde::Deserialize;
use tokio::sync::{Mutex, mpsc};
use tokio::time::Instant;

/// Name of the login question among the robot's initiatives.
pub(crate) const LOGIN: &str = "login";

/// Name of the method that lets a person log in.
pub(crate) const METHOD: &str = "log_in";

/// Time for which the screen is locked after too many wrong answers. With three attempts before
/// each lock, trying all PINs of four digits takes eleven days.
const LOCK_TIME: Duration = Duration::from_secs(5 * 60);

/// Time of an attempt beyond the wait for the person: for the transport of the question and the
/// answer.
const ATTEMPT_MARGIN: Duration = Duration::from_secs(2);

/// Minimum and maximum of the wait for a person, and of the validity of a login.
const DURATION_MIN: Duration = Duration::from_millis(1);
const DURATION_MAX: Duration = Duration::from_hours(24);

/// A request of the login to the actuator: to send a question, or to withdraw it.
enum QuestionRequest {
    This(String),
    /// Withdraws the question, because its answer is no longer needed.
    Nothing,
}

/// Capacity of the queue of requests, and of the queue of answers. Usually each has one element.
const WAITING_MAX: usize = 4;

/// The key `login` in the `config` of an entry.
#[derive(Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct LoginConfig {
    /// PIN that a person must enter to log in.
    #[serde(default)]
    pin: Option<String>,
    /// Path of a file with the PIN in its first line, in place of a PIN in the ecosystem file.
    #[serde(default)]
    pin_file: Option<PathBuf>,
    /// Time limit for one answer, such as `"60s"`.
    #[serde(default = "default_patience")]
    patience: String,
    /// Number of wrong answers in one login after which the screen is locked.
    #[serde(default = "default_attempts")]
    attempts: u32,
    /// Time for which a person counts as validated after the login, such as `"10min"`.
    #[serde(default = "default_valid_for")]
    valid_for: String,
}

config_tables!(LoginConfig);

fn default_patience() -> String {
    "60s".to_owned()
}

fn default_attempts() -> u32 {
    3
}

fn default_valid_for() -> String {
    "10min".to_owned()
}

/// The PIN for comparison with answers. The type has no `Debug`, so that the PIN cannot get into a
/// log.
#[derive(Clone)]
struct Secret(Arc<str>);

impl Secret {
    /// Whether `answer` is the PIN. The duration of the comparison does not depend on the position
    /// of the first difference, so that the PIN cannot be guessed digit by digit.
    fn is(&self, answer: &str) -> bool {
        let (expected, given) = (self.0.as_bytes(), answer.trim().as_bytes());
        let differs = |(expected, given): (&u8, &u8)| expected ^ given;
        let difference = expected.iter().zip(given).map(differs).fold(0, |all, one| all | one);
        expected.len() == given.len() && difference == 0
    }
}

/// Reads a PIN from a file. Returns an error if all users of the machine have access to the file,
/// or if its group can change it.
///
/// The group may read the file, because systemd passes credentials to services in this way, and
/// administrators let a daemon read a file of root in this way.
fn read_pin(path: &Path) -> Result<String, String> {
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    let mode = file.metadata().map_err(|error| error.to_string())?.mode() & 0o777;
    if mode & 0o027 != 0 {
        let path = path.display();
        return Err(format!(
            "other users can read or change it (mode {mode:03o}); close it with `chmod 600 {path}`"
        ));
    }
    let mut text = String::new();
    file.read_to_string(&mut text).map_err(|error| error.to_string())?;
    Ok(text)
}

/// Time until which the screen is locked. The login and its current attempt share this value.
type LoginLock = Arc<std::sync::Mutex<Option<Instant>>>;

/// The login at the robot's on-board screen.
pub(crate) struct Login {
    secret: Secret,
    patience: Duration,
    attempts: u32,
    pub(crate) valid_for: Duration,
    lock: LoginLock,
    /// Number of wrong answers since the last right one, or since the screen was locked.
    wrong_answers: Arc<AtomicU32>,
    requests: mpsc::Sender<QuestionRequest>,
    pending_requests: Arc<Mutex<mpsc::Receiver<QuestionRequest>>>,
    /// Queue of answers to the current attempt; `None` if there is no attempt.
    answers: Option<mpsc::Sender<InitiativeUpdate>>,
}

impl Login {
    pub(crate) fn new(blueprint: &Blueprint, config: LoginConfig) -> Result<Login, BuildError> {
        let LoginConfig { pin, pin_file, patience, attempts, valid_for } = config;
        let problem = |text: String| blueprint.problem(text);
        let is_rehearsal = blueprint.host.resources.get::<BuildCheck>().is_some();
        let secret = match (pin, pin_file) {
            (Some(pin), None) => pin,
            // The file is on the robot's own machine, and is not read in a check of the build.
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
            let what = "`login` needs a PIN that is not empty, and `attempts` of at least 1";
            return Err(problem(what.to_owned()));
        }
        let duration = |key: &str, text: &str| {
            config_duration(key, text, DURATION_MIN..=DURATION_MAX).map_err(problem)
        };
        let (ask, asked) = mpsc::channel(WAITING_MAX);
        Ok(Login {
            secret: Secret(Arc::from(secret)),
            patience: duration("patience", &patience)?,
            attempts,
            valid_for: duration("valid-for", &valid_for)?,
            lock: LoginLock::default(),
            wrong_answers: Arc::default(),
            requests: ask,
            pending_requests: Arc::new(Mutex::new(asked)),
            answers: None,
        })
    }

    /// Whether the screen can be used for a login at present, because it is not locked.
    pub(crate) fn is_open(&self) -> bool {
        let until = *self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        until.is_none_or(|until| until <= Instant::now())
    }

    /// Returns the time limit of a login with all its attempts.
    pub(crate) fn timeout(&self) -> Duration {
        (self.patience + ATTEMPT_MARGIN) * self.attempts
    }

    /// Asks the person at `place` for the PIN, and waits for the result of the login.
    pub(crate) fn log_in(&mut self, place: String) -> BoxFuture<Result<String, MethodFailure>> {
        let (answer, answers) = mpsc::channel(WAITING_MAX);
        self.answers = Some(answer);
        let attempt = LoginAttempt {
            secret: self.secret.clone(),
            lock: Arc::clone(&self.lock),
            wrong_answers: Arc::clone(&self.wrong_answers),
            rest: self.patience,
            requests: self.requests.clone(),
            answers,
            is_open: false,
            attempts: self.attempts,
            place,
        };
        Box::pin(attempt.run())
    }

    /// Waits until the login has a question to send or to withdraw, and returns the initiatives for
    /// that.
    pub(crate) fn next_question(&self) -> BoxFuture<Vec<Initiative>> {
        let (asked, patience) = (Arc::clone(&self.pending_requests), self.patience);
        Box::pin(async move {
            match asked.lock().await.recv().await {
                Some(QuestionRequest::Nothing) => {
                    vec![Initiative::Withdraw { name: LOGIN.to_owned() }]
                }
                Some(QuestionRequest::This(text)) => {
                    let (name, question) = (LOGIN.to_owned(), Question::new(text));
                    vec![Initiative::AskPeople { name, question, patience }]
                }
                // The robot has ended; this future will be dropped.
                None => std::future::pending().await,
            }
        })
    }

    /// Passes a person's answer to the current attempt.
    pub(crate) fn receive_answer(&mut self, news: &InitiativeUpdate) {
        // Sending fails if the attempt has ended or its queue is full.
        let is_lost =
            |answers: &mpsc::Sender<InitiativeUpdate>| answers.try_send(news.clone()).is_err();
        if self.answers.as_ref().is_some_and(is_lost) {
            self.answers = None;
        }
    }
}

/// One login of a person, with all its questions.
struct LoginAttempt {
    secret: Secret,
    lock: LoginLock,
    /// Number of wrong answers, also in earlier attempts: one that is cancelled forgives none.
    wrong_answers: Arc<AtomicU32>,
    /// Time for which the screen is locked if no answer comes, or if the keyboard refuses the
    /// question.
    rest: Duration,
    requests: mpsc::Sender<QuestionRequest>,
    answers: mpsc::Receiver<InitiativeUpdate>,
    /// Whether the robot waits for an answer at present.
    is_open: bool,
    attempts: u32,
    place: String,
}

impl LoginAttempt {
    async fn run(mut self) -> Result<String, MethodFailure> {
        let failed = |why: &str| MethodFailure::Driver(why.to_owned());
        let mut again = "";
        loop {
            let text = format!("{again}Who is at {}? Log in with your PIN.", self.place);
            let asked = self.requests.send(QuestionRequest::This(text)).await;
            asked.map_err(|_| failed("ask for a PIN: the screen is off"))?;
            self.is_open = true;
            let answer = self.answers.recv().await;
            self.is_open = false;
            match answer {
                Some(InitiativeUpdate::Answer(answer)) if self.secret.is(&answer) => {
                    self.wrong_answers.store(0, Ordering::Relaxed);
                    return Ok(self.place.clone());
                }
                Some(InitiativeUpdate::Answer(_)) => {
                    again = "That was wrong. ";
                    if self.wrong_answers.fetch_add(1, Ordering::Relaxed) + 1 >= self.attempts {
                        self.wrong_answers.store(0, Ordering::Relaxed);
                        self.close_for(LOCK_TIME);
                        let wrong = self.attempts;
                        return Err(failed(&format!(
                            "validate a person: {wrong} answers were wrong"
                        )));
                    }
                }
                Some(InitiativeUpdate::Refused(refusal)) => {
                    self.close_for(self.rest);
                    return Err(failed(&format!("validate a person: {}", refusal.detail)));
                }
                Some(InitiativeUpdate::Unanswered(why)) => {
                    self.close_for(self.rest);
                    return Err(failed(&format!("validate a person: {why}")));
                }
                Some(InitiativeUpdate::Report(_)) | None => {
                    return Err(failed("receive an answer"));
                }
            }
        }
    }

    fn close_for(&self, time: Duration) {
        let until = Instant::now() + time;
        *self.lock.lock().unwrap_or_else(PoisonError::into_inner) = Some(until);
    }
}

impl Drop for LoginAttempt {
    fn drop(&mut self) {
        // If the attempt was cancelled, the question is withdrawn, so that no person goes to a
        // keyboard for it. If the queue is full, the question ends at its deadline.
        if self.is_open {
            let _ = self.requests.try_send(QuestionRequest::Nothing);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_pin_file_that_others_can_access_is_refused_with_a_correction() {
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
