//! The tokens an actuator has taken on: each is executed at most once, also by its next life.
//!
//! The actuator is the arbiter (design, “Execution”): a token is on disk before its method runs,
//! and a token of an older plan for a goal than the newest seen is refused. Who asks for a token
//! again, because it has taken over from who asked first, learns what became of it; that cannot be
//! known of one that a former life began and did not end.

use std::collections::{HashMap, VecDeque};
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use acl::content::{ActionToken, Outcome, Report};
use acl::{AgentId, ConversationId};
use agent::StateFolder;
use serde::{Deserialize, Serialize};

/// Reports remembered whole: who takes over asks for those of the plans that run. Of the others
/// the outcome is enough.
const REPORTS_MAX: usize = 256;

/// The tokens taken on so far.
#[derive(Debug)]
pub(crate) struct Ledger {
    path: Option<PathBuf>,
    tokens_max: usize,
    taken: HashMap<ActionToken, Mark>,
    order: VecDeque<ActionToken>,
    reports: VecDeque<(ActionToken, Report)>,
    /// The newest plan seen for each goal: of which term, and which round of it.
    newest: HashMap<ConversationId, (u64, u32)>,
}

/// What is known of a token.
#[derive(Debug, PartialEq)]
pub(crate) enum Known {
    /// Nothing: it may be executed.
    New,
    /// It is of an older plan than another that was seen for its goal.
    Stale,
    /// It was begun, and nothing says that it ended.
    Begun,
    /// It ended so.
    Ended(Box<Report>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mark {
    Begun,
    Ended(Outcome),
}

/// A line of the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Line {
    Begun(ActionToken),
    Ended {
        token: ActionToken,
        report: Report,
    },
    /// What an earlier version wrote, for a token that was begun.
    #[serde(untagged)]
    Bare(ActionToken),
}

impl Ledger {
    /// One that remembers so many tokens, while the process lives.
    fn new(tokens_max: usize) -> Ledger {
        Ledger {
            path: None,
            tokens_max,
            taken: HashMap::new(),
            order: VecDeque::new(),
            reports: VecDeque::new(),
            newest: HashMap::new(),
        }
    }

    /// Reads what a former life has taken on. Without a folder, nothing outlives the process.
    ///
    /// # Errors
    ///
    /// If the file is there and cannot be read. A torn last line is a token whose method never
    /// ran, or one of which nobody knows how it ended: it is left out.
    pub(crate) fn open(
        agent: &AgentId,
        folder: Option<&StateFolder>,
        tokens_max: usize,
    ) -> io::Result<Ledger> {
        let mut ledger = Ledger::new(tokens_max);
        let Some(folder) = folder else { return Ok(ledger) };
        let path = folder.0.join(format!("{agent}.tokens"));
        ledger.path = Some(path.clone());
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(ledger),
            Err(error) => return Err(error),
        };
        for line in BufReader::new(file).split(b'\n') {
            match serde_json::from_slice(&line?) {
                Ok(Line::Begun(token) | Line::Bare(token)) => ledger.note(token),
                Ok(Line::Ended { token, report }) => ledger.note_end(token, report),
                Err(_) => (),
            }
        }
        ledger.rewrite(&path)?;
        Ok(ledger)
    }

    /// What is known of a token.
    pub(crate) fn known(&self, token: &ActionToken) -> Known {
        match self.taken.get(token) {
            Some(Mark::Begun) => Known::Begun,
            Some(Mark::Ended(outcome)) => {
                let whole = self.reports.iter().find(|(other, _)| other == token);
                let detail = "it ended so before";
                let report = whole.map(|(_, report)| report.clone());
                Known::Ended(Box::new(report.unwrap_or_else(|| Report::new(*outcome, detail))))
            }
            None => {
                let newest = self.newest.get(&token.conversation).copied().unwrap_or_default();
                if (token.epoch, token.round) < newest { Known::Stale } else { Known::New }
            }
        }
    }

    /// Takes a token on. What comes back puts it on disk, and may wait for the disk; the method
    /// runs only after it has.
    pub(crate) fn take(&mut self, token: ActionToken) -> impl FnOnce() -> io::Result<()> + use<> {
        let path = self.path.clone();
        let line = serde_json::to_string(&Line::Begun(token.clone()));
        self.note(token);
        move || match path {
            Some(path) => append(&path, &line?)?.sync_data(),
            None => Ok(()),
        }
    }

    /// A token has ended. What comes back writes that down; it need not wait for the disk: should
    /// the machine lose its power first, how it ended is not known, and nobody says otherwise.
    pub(crate) fn end(
        &mut self,
        token: ActionToken,
        report: Report,
    ) -> impl FnOnce() -> io::Result<()> + use<> {
        let path = self.path.clone();
        let line = Line::Ended { token: token.clone(), report: report.clone() };
        let line = serde_json::to_string(&line);
        self.note_end(token, report);
        move || match path {
            Some(path) => append(&path, &line?).map(drop),
            None => Ok(()),
        }
    }

    fn note(&mut self, token: ActionToken) {
        let newest = self.newest.entry(token.conversation.clone()).or_default();
        *newest = (*newest).max((token.epoch, token.round));
        if self.taken.insert(token.clone(), Mark::Begun).is_none() {
            self.order.push_back(token);
        }
        if self.order.len() > self.tokens_max
            && let Some(oldest) = self.order.pop_front()
        {
            self.taken.remove(&oldest);
            let is_of_it = |token: &ActionToken| token.conversation == oldest.conversation;
            if self.order.front().is_none_or(|next| !is_of_it(next))
                && !self.order.iter().any(is_of_it)
            {
                self.newest.remove(&oldest.conversation);
            }
        }
    }

    fn note_end(&mut self, token: ActionToken, report: Report) {
        if !self.taken.contains_key(&token) {
            self.note(token.clone());
        }
        self.taken.insert(token.clone(), Mark::Ended(report.outcome));
        if self.reports.len() >= REPORTS_MAX {
            self.reports.pop_front();
        }
        self.reports.push_back((token, report));
    }

    /// Keeps the file as short as the memory. Written beside and renamed, so that a crash leaves
    /// one or the other.
    fn rewrite(&self, path: &Path) -> io::Result<()> {
        let beside = path.with_extension("tokens.new");
        let mut file = io::BufWriter::new(File::create(&beside)?);
        for token in &self.order {
            let line = match self.known(token) {
                Known::Ended(report) => Line::Ended { token: token.clone(), report: *report },
                _ => Line::Begun(token.clone()),
            };
            writeln!(file, "{}", serde_json::to_string(&line)?)?;
        }
        file.into_inner()?.sync_all()?;
        std::fs::rename(beside, path)
    }
}

fn append(path: &Path, line: &str) -> io::Result<File> {
    let mut file = OpenOptions::new().create(true).append(true).open(path)?;
    // One write: two that append at once do not mix. A torn line before it ends here.
    file.write_all(format!("{line}\n").as_bytes())?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn token(epoch: u64, round: u32, step: u32) -> ActionToken {
        ActionToken { epoch, conversation: ConversationId::new("c"), round, step }
    }

    const TOKENS_MAX: usize = 1_000;

    fn robot() -> AgentId {
        AgentId::new("robot").expect("a name")
    }

    fn open(folder: &StateFolder) -> Ledger {
        Ledger::open(&robot(), Some(folder), TOKENS_MAX).expect("readable")
    }

    #[test]
    fn a_token_is_taken_once_also_by_the_next_life() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = StateFolder(folder.path().to_owned());
        let mut ledger = open(&folder);
        let (ended, cut_off) = (token(5, 1, 0), token(5, 1, 1));
        assert_eq!(ledger.known(&ended), Known::New);
        ledger.take(ended.clone())().expect("written");
        assert_eq!(ledger.known(&ended), Known::Begun);
        let report = Report::new(Outcome::Done, "there");
        ledger.end(ended.clone(), report.clone())().expect("written");
        ledger.take(cut_off.clone())().expect("written");

        // The second time it is read from what the first wrote anew.
        for next_life in [open(&folder), open(&folder)] {
            assert_eq!(next_life.known(&ended), Known::Ended(Box::new(report.clone())));
            assert_eq!(next_life.known(&cut_off), Known::Begun);
            assert_eq!(next_life.known(&token(4, 9, 0)), Known::Stale, "of a former term");
            assert_eq!(next_life.known(&token(5, 0, 0)), Known::Stale, "of a former round");
            assert_eq!(next_life.known(&token(5, 1, 2)), Known::New);
            let other = ActionToken { conversation: ConversationId::new("d"), ..token(1, 1, 0) };
            assert_eq!(next_life.known(&other), Known::New, "of another goal");
        }
    }

    #[test]
    fn a_torn_line_is_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("robot.tokens");
        // The first line is how an earlier version wrote it.
        let earlier = serde_json::to_string(&token(1, 1, 0)).expect("JSON");
        let whole = serde_json::to_string(&Line::Begun(token(1, 1, 1))).expect("JSON");
        std::fs::write(&path, format!("{earlier}\n{whole}\n{}", &whole[..20])).expect("written");
        let ledger = open(&StateFolder(folder.path().to_owned()));
        assert_eq!(ledger.known(&token(1, 1, 0)), Known::Begun);
        assert_eq!(ledger.known(&token(1, 1, 1)), Known::Begun);
        assert_eq!(ledger.order.len(), 2);
    }

    #[test]
    fn what_is_remembered_has_a_bound() {
        let mut ledger = Ledger::new(TOKENS_MAX);
        let many = u32::try_from(TOKENS_MAX).expect("few") + 10;
        for step in 0..many {
            let token = token(1, 1, step);
            ledger.note_end(token, Report::new(Outcome::Done, "done"));
        }
        assert_eq!((ledger.order.len(), ledger.taken.len()), (TOKENS_MAX, TOKENS_MAX));
        assert_eq!(ledger.reports.len(), REPORTS_MAX);
        assert_eq!(ledger.known(&token(1, 0, 0)), Known::Stale);
        let Known::Ended(report) = ledger.known(&token(1, 1, 100)) else { panic!("it ended") };
        assert_eq!(report.outcome, Outcome::Done);
    }
}
