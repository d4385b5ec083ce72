//! The tokens an actuator has taken on: each is executed at most once, also by its next life.
//!
//! The actuator is the arbiter (design, “Execution”): a token is on disk before its method runs,
//! and a token of an older executor epoch than the newest seen is refused.

use std::collections::{HashSet, VecDeque};
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use acl::AgentId;
use acl::content::{ActionToken, Reason};

/// Tokens remembered. A goal's plan has tens of steps; ten thousand are days of work, and the
/// epoch guards what is older.
const TOKENS_MAX: usize = 10_000;

/// Where the daemon keeps what its agents must not forget.
#[derive(Clone, Debug)]
pub struct StateFolder(pub PathBuf);

/// The tokens taken on so far.
#[derive(Debug, Default)]
pub(crate) struct Ledger {
    path: Option<PathBuf>,
    taken: HashSet<ActionToken>,
    order: VecDeque<ActionToken>,
    newest_epoch: u64,
}

impl Ledger {
    /// Reads what a former life has taken on. Without a folder, nothing outlives the process.
    ///
    /// # Errors
    ///
    /// If the file is there and cannot be read. A torn last line is a token whose method never
    /// ran: it is left out.
    pub(crate) fn open(agent: &AgentId, folder: Option<&StateFolder>) -> io::Result<Ledger> {
        let path = folder.map(|folder| folder.0.join(format!("{agent}.tokens")));
        let mut ledger = Ledger { path, ..Ledger::default() };
        let Some(path) = ledger.path.clone() else { return Ok(ledger) };
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(ledger),
            Err(error) => return Err(error),
        };
        for line in BufReader::new(file).lines() {
            if let Ok(token) = serde_json::from_str(&line?) {
                ledger.note(token);
            }
        }
        ledger.rewrite(&path)?;
        Ok(ledger)
    }

    /// Why a token may not be executed, if so.
    pub(crate) fn objection(&self, token: &ActionToken) -> Option<Reason> {
        if self.taken.contains(token) {
            return Some(Reason::AlreadyExecuted);
        }
        (token.epoch < self.newest_epoch).then_some(Reason::StaleToken)
    }

    /// Takes a token on. What comes back puts it on disk, and may wait for the disk; the method
    /// runs only after it has.
    pub(crate) fn take(&mut self, token: ActionToken) -> impl FnOnce() -> io::Result<()> + use<> {
        let path = self.path.clone();
        let line = serde_json::to_string(&token);
        self.note(token);
        move || {
            let Some(path) = path else { return Ok(()) };
            let mut file = OpenOptions::new().create(true).append(true).open(path)?;
            writeln!(file, "{}", line?)?;
            file.sync_data()
        }
    }

    fn note(&mut self, token: ActionToken) {
        self.newest_epoch = self.newest_epoch.max(token.epoch);
        if self.taken.insert(token.clone()) {
            self.order.push_back(token);
        }
        if self.order.len() > TOKENS_MAX
            && let Some(oldest) = self.order.pop_front()
        {
            self.taken.remove(&oldest);
        }
    }

    /// Keeps the file as short as the memory. Written beside and renamed, so that a crash leaves
    /// one or the other.
    fn rewrite(&self, path: &Path) -> io::Result<()> {
        let beside = path.with_extension("tokens.new");
        let mut file = File::create(&beside)?;
        for token in &self.order {
            writeln!(file, "{}", serde_json::to_string(token)?)?;
        }
        file.sync_all()?;
        std::fs::rename(beside, path)
    }
}

#[cfg(test)]
mod tests {
    use acl::ConversationId;

    use super::*;

    fn token(epoch: u64, step: u32) -> ActionToken {
        ActionToken { epoch, conversation: ConversationId::new("c"), round: 1, step }
    }

    #[test]
    fn a_token_is_taken_once_also_by_the_next_life() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = StateFolder(folder.path().to_owned());
        let robot = AgentId::new("robot").expect("a name");
        let mut ledger = Ledger::open(&robot, Some(&folder)).expect("nothing there yet");
        assert_eq!(ledger.objection(&token(5, 0)), None);
        ledger.take(token(5, 0))().expect("written");
        assert_eq!(ledger.objection(&token(5, 0)), Some(Reason::AlreadyExecuted));

        let next_life = Ledger::open(&robot, Some(&folder)).expect("readable");

        assert_eq!(next_life.objection(&token(5, 0)), Some(Reason::AlreadyExecuted));
        assert_eq!(next_life.objection(&token(4, 9)), Some(Reason::StaleToken));
        assert_eq!(next_life.objection(&token(5, 1)), None);
    }

    #[test]
    fn a_torn_line_is_a_method_that_never_ran() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("robot.tokens");
        let whole = serde_json::to_string(&token(1, 0)).expect("JSON");
        std::fs::write(&path, format!("{whole}\n{}", &whole[..20])).expect("written");
        let robot = AgentId::new("robot").expect("a name");
        let ledger = Ledger::open(&robot, Some(&StateFolder(folder.path().to_owned())));
        let ledger = ledger.expect("readable");
        assert_eq!(ledger.objection(&token(1, 0)), Some(Reason::AlreadyExecuted));
        assert_eq!(ledger.order.len(), 1);
    }
}
