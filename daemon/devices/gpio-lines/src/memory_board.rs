//! Board with lines in memory, for tests of code that watches or drives lines.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use crate::{
    BoxFuture, GpioBoard, InputLine, InputSettings, LineError, LineName, OutputLine, OutputSettings,
};

/// Error number of the kernel for an operation on a chip that is gone (`ENODEV`).
const NO_SUCH_DEVICE: i32 = 19;

/// Board on which tests plug in, set and unplug lines. All clones refer to the same board.
#[derive(Clone, Default)]
pub struct MemoryBoard(Arc<Mutex<MemoryLines>>);

#[derive(Default)]
struct MemoryLines {
    lines: BTreeMap<String, MemoryLine>,
    edge_reports_disabled: bool,
}

#[derive(Clone)]
struct MemoryLine {
    /// Whether the level of the line is high; `None` after the line is unplugged.
    level: Arc<watch::Sender<Option<bool>>>,
    /// Whether the level of the line is fixed, as if by something stronger than the line's driver.
    is_held: bool,
    /// Reference count of the line's users: an opened line holds a clone of this value until it is
    /// closed.
    used: Arc<()>,
}

impl MemoryBoard {
    /// Plugs in a line, with a high level if `is_high` is `true`.
    pub fn plug(&self, name: &str, is_high: bool) {
        let level = Arc::new(watch::channel(Some(is_high)).0);
        let line = MemoryLine { level, is_held: false, used: Arc::default() };
        self.lock().lines.insert(name.to_owned(), line);
    }

    /// Unplugs the line with this name.
    pub fn unplug(&self, name: &str) {
        if let Some(line) = self.lock().lines.remove(name) {
            line.level.send_replace(None);
        }
    }

    /// Sets the level of a line from outside, as its circuit would.
    pub fn set(&self, name: &str, is_high: bool) {
        if let Some(line) = self.lock().lines.get(name) {
            line.level.send_replace(Some(is_high));
        }
    }

    /// Returns `true` if the level of a line is high; `None` if there is no such line.
    pub fn level(&self, name: &str) -> Option<bool> {
        self.lock().lines.get(name).and_then(|line| *line.level.borrow())
    }

    /// Fixes the current level of a line, so that driving the line has no effect.
    pub fn fix_level(&self, name: &str) {
        if let Some(line) = self.lock().lines.get_mut(name) {
            line.is_held = true;
        }
    }

    /// Turns off the reports of edges for all lines that are opened from now on.
    pub fn disable_edge_reports(&self) {
        self.lock().edge_reports_disabled = true;
    }

    fn open(&self, name: &LineName, is_active_low: bool) -> Result<OpenMemoryLine, LineError> {
        let (name, lines) = (name.to_string(), self.lock());
        let line = lines.lines.get(&name).cloned().ok_or_else(|| LineError::NoName {
            wanted: name.clone(),
            near: None,
            known: Vec::new(),
        })?;
        // Two references always exist: the one of the board, and the clone in this function.
        if Arc::strong_count(&line.used) > 2 {
            return Err(LineError::Used {
                line: name,
                consumer: "another agent of Althing".to_owned(),
            });
        }
        Ok(OpenMemoryLine {
            name,
            is_active_low,
            reports_edges: !lines.edge_reports_disabled,
            line,
        })
    }

    fn lock(&self) -> MutexGuard<'_, MemoryLines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl GpioBoard for MemoryBoard {
    fn input(&self, wanted: &InputSettings) -> Result<Box<dyn InputLine>, LineError> {
        let opened = self.open(&wanted.line, wanted.is_active_low)?;
        // Edges are recorded from this moment on, even if no task waits for them yet.
        let heard = tokio::sync::Mutex::new(opened.line.level.subscribe());
        Ok(Box::new(MemoryInput { opened, levels: heard }))
    }

    fn output(&self, wanted: &OutputSettings) -> Result<Box<dyn OutputLine>, LineError> {
        Ok(Box::new(self.open(&wanted.line, wanted.is_active_low)?))
    }
}

struct OpenMemoryLine {
    name: String,
    is_active_low: bool,
    reports_edges: bool,
    line: MemoryLine,
}

impl OpenMemoryLine {
    fn is_active(&self, what: &'static str, level: Option<bool>) -> Result<bool, LineError> {
        let is_high = level.ok_or_else(|| LineError::Kernel {
            what,
            line: self.name.clone(),
            source: io::Error::from_raw_os_error(NO_SUCH_DEVICE),
        })?;
        Ok(is_high != self.is_active_low)
    }
}

struct MemoryInput {
    opened: OpenMemoryLine,
    levels: tokio::sync::Mutex<watch::Receiver<Option<bool>>>,
}

impl InputLine for MemoryInput {
    fn value(&self) -> Result<bool, LineError> {
        self.opened.is_active("read", *self.opened.line.level.borrow())
    }

    fn edges(&self) -> BoxFuture<'_, Result<Vec<bool>, LineError>> {
        Box::pin(async move {
            if !self.opened.reports_edges {
                std::future::pending::<()>().await;
            }
            let mut heard = self.levels.lock().await;
            // The call cannot fail, because this line owns the sender.
            let _ = heard.changed().await;
            let level = *heard.borrow_and_update();
            Ok(vec![self.opened.is_active("wait for", level)?])
        })
    }

    fn reports_edges(&self) -> bool {
        self.opened.reports_edges
    }
}

impl OutputLine for OpenMemoryLine {
    fn value(&self) -> Result<bool, LineError> {
        self.is_active("read", *self.line.level.borrow())
    }

    fn set(&self, is_active: bool) -> Result<(), LineError> {
        self.is_active("drive", *self.line.level.borrow())?;
        if !self.line.is_held {
            self.line.level.send_replace(Some(is_active != self.is_active_low));
        }
        Ok(())
    }
}
