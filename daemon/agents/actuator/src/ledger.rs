//! Command ledger of an actuator: a file that ensures that each token is executed at most once,
//! even across incarnations.
//!
//! A token identifies the execution of one step (docs/design.md, “Execution”), and is on disk
//! before the method of that step runs. A token is refused if it belongs to an older plan than the
//! newest one seen for its goal. A Plan Executor that takes over and requests a token again gets
//! the outcome of that token. If an earlier incarnation of the actuator began a token and did not
//! end it, the outcome is unknown.

use std::collections::{HashMap, VecDeque};
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use acl::content::{ActionToken, Outcome, Report};
use acl::{AgentId, ConversationId};
use agent::{StateFolder, replace_file};
use serde::{Deserialize, Serialize};

/// Maximum number of reports kept in full; for older commands, only the outcome is kept. A Plan
/// Executor that takes over requests the reports of running plans.
const REPORTS_MAX: usize = 256;

/// Factor: the ledger's file is rewritten when it has this many times as many lines as it needs.
const LONGER_MAX: usize = 4;

/// Ledger of an actuator: the commands that were begun so far, by their tokens, and how they ended.
#[derive(Debug)]
pub(crate) struct Ledger {
    file: Option<Arc<Mutex<LedgerFile>>>,
    tokens_max: usize,
    tokens: HashMap<ActionToken, TokenMark>,
    order: VecDeque<ActionToken>,
    reports: VecDeque<(ActionToken, Report)>,
    /// The newest plan seen for each goal: the term of its leader, and its number (round) in that
    /// term.
    newest_plans: HashMap<ConversationId, (u64, u32)>,
}

/// State of a command in the ledger, by its token.
#[derive(Debug, PartialEq)]
pub(crate) enum TokenState {
    /// The command was not seen before, so it may be executed.
    New,
    /// The command belongs to an older plan than the newest one seen for its goal.
    Stale,
    /// The command was begun, and no outcome of it is recorded.
    Begun,
    /// The execution of the command ended with this report.
    Ended(Box<Report>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TokenMark {
    Begun,
    Ended(Outcome),
}

/// The ledger's file, with the number of its lines.
#[derive(Debug)]
struct LedgerFile {
    path: PathBuf,
    lines: usize,
    tokens_max: usize,
}

/// Content of a ledger's file.
struct LedgerContents {
    ledger: Ledger,
    lines: usize,
    /// Number of lines that could not be parsed: a crash or a full disk tore the line, or a newer
    /// version wrote it.
    unread: usize,
}

/// A line of the ledger's file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LedgerLine {
    Begun(ActionToken),
    Ended {
        token: ActionToken,
        report: Report,
    },
    /// Line that an earlier version of this program wrote for a command that was begun.
    #[serde(untagged)]
    Bare(ActionToken),
}

impl Ledger {
    /// Creates a ledger in memory that keeps up to `tokens_max` commands.
    fn new(tokens_max: usize) -> Ledger {
        Ledger {
            file: None,
            tokens_max,
            tokens: HashMap::new(),
            order: VecDeque::new(),
            reports: VecDeque::new(),
            newest_plans: HashMap::new(),
        }
    }

    /// Loads the command ledger of earlier incarnations from `folder`. If `folder` is `None`, the
    /// ledger is in memory only.
    ///
    /// # Errors
    ///
    /// Returns an error if the ledger's file exists and cannot be read.
    pub(crate) fn open(
        agent: &AgentId,
        folder: Option<&StateFolder>,
        tokens_max: usize,
    ) -> io::Result<Ledger> {
        let Some(folder) = folder else { return Ok(Ledger::new(tokens_max)) };
        let path = folder.0.join(format!("{agent}.tokens"));
        let LedgerContents { mut ledger, lines, .. } = match read(&path, tokens_max) {
            Ok(read) => read,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                LedgerContents::nothing(tokens_max)
            }
            Err(error) => return Err(error),
        };
        let mut filed = LedgerFile { path, lines, tokens_max };
        if lines > 0 {
            filed.compact();
        }
        ledger.file = Some(Arc::new(Mutex::new(filed)));
        Ok(ledger)
    }

    /// Returns the state of the command with this token.
    pub(crate) fn state_of(&self, token: &ActionToken) -> TokenState {
        match self.tokens.get(token) {
            Some(TokenMark::Begun) => TokenState::Begun,
            Some(TokenMark::Ended(outcome)) => {
                let whole = self.reports.iter().find(|(other, _)| other == token);
                let detail = "it ended earlier";
                let report = whole.map(|(_, report)| report.clone());
                TokenState::Ended(Box::new(report.unwrap_or_else(|| Report::new(*outcome, detail))))
            }
            None => {
                let newest =
                    self.newest_plans.get(&token.conversation).copied().unwrap_or_default();
                if (token.term, token.round) < newest { TokenState::Stale } else { TokenState::New }
            }
        }
    }

    /// Marks the command with this token as begun. Returns a function that writes this mark to disk
    /// and waits for the disk; the method of the step may run only after that function has
    /// succeeded.
    pub(crate) fn begin_token(
        &mut self,
        token: ActionToken,
    ) -> impl FnOnce() -> io::Result<()> + use<> {
        let file = self.file.clone();
        let line = serde_json::to_string(&LedgerLine::Begun(token.clone()));
        self.insert_begun(token);
        move || match file {
            Some(file) => lock(&file).append(&line?)?.sync_data(),
            None => Ok(()),
        }
    }

    /// Marks the command with this token as ended. Returns a function that appends its outcome to
    /// the file, without waiting for the disk. After a power cut the outcome may be missing; the
    /// command then counts as begun.
    pub(crate) fn end_token(
        &mut self,
        token: ActionToken,
        report: Report,
    ) -> impl FnOnce() -> io::Result<()> + use<> {
        let file = self.file.clone();
        let line = LedgerLine::Ended { token: token.clone(), report: report.clone() };
        let line = serde_json::to_string(&line);
        self.insert_ended(token, report);
        move || {
            let Some(file) = file else { return Ok(()) };
            let mut file = lock(&file);
            file.append(&line?)?;
            if file.is_long() {
                file.compact();
            }
            Ok(())
        }
    }

    fn insert_begun(&mut self, token: ActionToken) {
        let newest = self.newest_plans.entry(token.conversation.clone()).or_default();
        *newest = (*newest).max((token.term, token.round));
        if self.tokens.insert(token.clone(), TokenMark::Begun).is_none() {
            self.order.push_back(token);
        }
        if self.order.len() > self.tokens_max
            && let Some(oldest) = self.order.pop_front()
        {
            self.tokens.remove(&oldest);
            let is_of_it = |token: &ActionToken| token.conversation == oldest.conversation;
            if self.order.front().is_none_or(|next| !is_of_it(next))
                && !self.order.iter().any(is_of_it)
            {
                self.newest_plans.remove(&oldest.conversation);
            }
        }
    }

    fn insert_ended(&mut self, token: ActionToken, report: Report) {
        if !self.tokens.contains_key(&token) {
            self.insert_begun(token.clone());
        }
        self.tokens.insert(token.clone(), TokenMark::Ended(report.outcome));
        if self.reports.len() >= REPORTS_MAX {
            self.reports.pop_front();
        }
        self.reports.push_back((token, report));
    }

    /// Returns the lines that a new file needs for everything in the ledger.
    fn lines(&self) -> impl Iterator<Item = LedgerLine> + '_ {
        self.order.iter().map(|token| match self.state_of(token) {
            TokenState::Ended(report) => {
                LedgerLine::Ended { token: token.clone(), report: *report }
            }
            _ => LedgerLine::Begun(token.clone()),
        })
    }
}

// === impl LedgerFile ===

impl LedgerFile {
    fn append(&mut self, line: &str) -> io::Result<File> {
        let mut file = OpenOptions::new().create(true).append(true).open(&self.path)?;
        self.lines += 1;
        // The text begins with a line break, which ends a line that a full disk or a power cut has
        // torn. Otherwise both would form one unreadable line, although the new token is executed.
        file.write_all(format!("\n{line}\n").as_bytes())?;
        Ok(file)
    }

    fn is_long(&self) -> bool {
        // Each token has two lines.
        self.lines > LONGER_MAX * 2 * self.tokens_max.max(REPORTS_MAX)
    }

    /// Shortens the file to the lines that the ledger keeps. A full disk is tolerated: lines are
    /// appended as long as there is room, and shortening is tried again when the file has grown by
    /// half of its maximum length.
    fn compact(&mut self) {
        match self.rewrite() {
            Ok(lines) => self.lines = lines,
            Err(error) => {
                self.lines /= 2;
                tracing::warn!(file = %self.path.display(), %error,
                    "the ledger could not be rewritten");
            }
        }
    }

    /// Replaces the file by a new one. Returns the number of lines in the new file. If some lines
    /// cannot be parsed, keeps a copy of the old file, because a newer version may have written
    /// these lines.
    fn rewrite(&self) -> io::Result<usize> {
        let LedgerContents { ledger, unread, .. } = read(&self.path, self.tokens_max)?;
        if unread > 0 {
            let aside = self.path.with_extension("tokens.unread");
            tracing::warn!(file = %self.path.display(), copy = %aside.display(), unread,
                "lines of the ledger cannot be read");
            std::fs::copy(&self.path, aside)?;
        }
        let (mut text, mut lines) = (Vec::new(), 0);
        for line in ledger.lines() {
            serde_json::to_writer(&mut text, &line)?;
            text.push(b'\n');
            lines += 1;
        }
        replace_file(&self.path, &text)?;
        Ok(lines)
    }
}

// === impl LedgerContents ===

impl LedgerContents {
    fn nothing(tokens_max: usize) -> LedgerContents {
        LedgerContents { ledger: Ledger::new(tokens_max), lines: 0, unread: 0 }
    }
}

/// Reads the ledger's file `path`. Skips lines that cannot be parsed, and counts them.
fn read(path: &Path, tokens_max: usize) -> io::Result<LedgerContents> {
    let LedgerContents { mut ledger, mut lines, mut unread } = LedgerContents::nothing(tokens_max);
    for line in BufReader::new(File::open(path)?).split(b'\n') {
        let line = line?;
        if line.is_empty() {
            continue;
        }
        lines += 1;
        match serde_json::from_slice(&line) {
            Ok(LedgerLine::Begun(token) | LedgerLine::Bare(token)) => ledger.insert_begun(token),
            Ok(LedgerLine::Ended { token, report }) => ledger.insert_ended(token, report),
            Err(_) => unread += 1,
        }
    }
    Ok(LedgerContents { ledger, lines, unread })
}

fn lock(file: &Mutex<LedgerFile>) -> std::sync::MutexGuard<'_, LedgerFile> {
    file.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn token(term: u64, round: u32, step: u32) -> ActionToken {
        ActionToken { term, conversation: ConversationId::new("c"), round, step }
    }

    const TOKENS_MAX: usize = 1_000;

    fn robot() -> AgentId {
        AgentId::new("robot").expect("a name")
    }

    fn open(folder: &StateFolder) -> Ledger {
        Ledger::open(&robot(), Some(folder), TOKENS_MAX).expect("readable")
    }

    #[test]
    fn a_token_is_executed_once_across_incarnations() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = StateFolder(folder.path().to_owned());
        let mut ledger = open(&folder);
        let (ended, cut_off) = (token(5, 1, 0), token(5, 1, 1));
        assert_eq!(ledger.state_of(&ended), TokenState::New);
        ledger.begin_token(ended.clone())().expect("written");
        assert_eq!(ledger.state_of(&ended), TokenState::Begun);
        let report = Report::new(Outcome::Done, "there");
        ledger.end_token(ended.clone(), report.clone())().expect("written");
        ledger.begin_token(cut_off.clone())().expect("written");

        // The second time it is read from the file that the first rewrote.
        for next_life in [open(&folder), open(&folder)] {
            assert_eq!(next_life.state_of(&ended), TokenState::Ended(Box::new(report.clone())));
            assert_eq!(next_life.state_of(&cut_off), TokenState::Begun);
            assert_eq!(next_life.state_of(&token(4, 9, 0)), TokenState::Stale, "of a former term");
            assert_eq!(next_life.state_of(&token(5, 0, 0)), TokenState::Stale, "of a former round");
            assert_eq!(next_life.state_of(&token(5, 1, 2)), TokenState::New);
            let other = ActionToken { conversation: ConversationId::new("d"), ..token(1, 1, 0) };
            assert_eq!(next_life.state_of(&other), TokenState::New, "of another goal");
        }
    }

    #[test]
    fn a_torn_line_is_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("robot.tokens");
        // The first two lines are those of earlier versions.
        let first = r#"{"epoch":1,"conversation":"c","round":1,"step":0}"#;
        let second = r#"{"begun":{"epoch":1,"conversation":"c","round":1,"step":2}}"#;
        let earlier = format!("{first}\n{second}");
        let whole = serde_json::to_string(&LedgerLine::Begun(token(1, 1, 1))).expect("JSON");
        std::fs::write(&path, format!("{earlier}\n{whole}\n{}", &whole[..20])).expect("written");
        let ledger = open(&StateFolder(folder.path().to_owned()));
        assert_eq!(ledger.state_of(&token(1, 1, 0)), TokenState::Begun);
        assert_eq!(ledger.state_of(&token(1, 1, 1)), TokenState::Begun);
        assert_eq!(ledger.state_of(&token(1, 1, 2)), TokenState::Begun);
        assert_eq!(ledger.order.len(), 3);
    }

    #[test]
    fn a_token_begun_after_a_torn_line_is_read_by_the_next_incarnation() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("robot.tokens");
        let folder = StateFolder(folder.path().to_owned());
        let mut ledger = open(&folder);
        ledger.begin_token(token(1, 1, 0))().expect("written");
        // A line as a full disk leaves it.
        let mut file = OpenOptions::new().append(true).open(&path).expect("there");
        file.write_all(br#"{"begun":{"epoch":1,"conv"#).expect("written");
        ledger.begin_token(token(1, 1, 1))().expect("written");
        let next_life = open(&folder);
        assert_eq!(next_life.state_of(&token(1, 1, 0)), TokenState::Begun);
        assert_eq!(next_life.state_of(&token(1, 1, 1)), TokenState::Begun);
        assert!(path.with_extension("tokens.unread").exists(), "the unreadable file is kept");
    }

    #[test]
    fn a_ledger_that_cannot_be_rewritten_is_still_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("robot.tokens");
        let whole = serde_json::to_string(&LedgerLine::Begun(token(1, 1, 0))).expect("JSON");
        let text = format!("{whole}\n{}", &whole[..20]);
        std::fs::write(&path, &text).expect("written");
        // A folder at the path of the copy makes the copy fail, as a full disk would.
        std::fs::create_dir(path.with_extension("tokens.unread")).expect("made");
        let mut ledger = open(&StateFolder(folder.path().to_owned()));
        assert_eq!(ledger.state_of(&token(1, 1, 0)), TokenState::Begun);
        assert_eq!(std::fs::read_to_string(&path).expect("there"), text, "nothing is lost");
        ledger.begin_token(token(1, 1, 1))().expect("written");
        let next_life = open(&StateFolder(folder.path().to_owned()));
        assert_eq!(next_life.state_of(&token(1, 1, 1)), TokenState::Begun);
    }

    #[test]
    fn the_file_of_the_ledger_is_bounded() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("robot.tokens");
        let folder = StateFolder(folder.path().to_owned());
        let mut ledger = Ledger::open(&robot(), Some(&folder), 0).expect("readable");
        let bound = u32::try_from(LONGER_MAX * 2 * REPORTS_MAX).expect("few");
        let length = || std::fs::read(&path).expect("there").len();
        let mut end = |step| {
            let done = Report::new(Outcome::Done, "done");
            ledger.end_token(token(1, 1, step), done)().expect("written");
        };
        (0..bound).for_each(&mut end);
        let longest = length();
        end(bound);
        assert!(length() < longest, "it was written anew");
    }

    #[test]
    fn the_ledger_in_memory_is_bounded() {
        let mut ledger = Ledger::new(TOKENS_MAX);
        let many = u32::try_from(TOKENS_MAX).expect("few") + 10;
        for step in 0..many {
            let token = token(1, 1, step);
            ledger.insert_ended(token, Report::new(Outcome::Done, "done"));
        }
        assert_eq!((ledger.order.len(), ledger.tokens.len()), (TOKENS_MAX, TOKENS_MAX));
        assert_eq!(ledger.reports.len(), REPORTS_MAX);
        assert_eq!(ledger.state_of(&token(1, 0, 0)), TokenState::Stale);
        let TokenState::Ended(report) = ledger.state_of(&token(1, 1, 100)) else {
            panic!("it ended")
        };
        assert_eq!(report.outcome, Outcome::Done);
    }
}
