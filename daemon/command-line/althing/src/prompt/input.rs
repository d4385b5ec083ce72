//! Reads the lines of the prompt: at a terminal with editing, completion and history; otherwise
//! unchanged. Reading runs on a separate thread, because it cannot be interrupted.

use std::borrow::Cow;
use std::io::{BufRead as _, IsTerminal as _};
use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

use acl::{DaemonId, EcosystemId};
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};
use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::history::FileHistory;
use rustyline::validate::Validator;
use rustyline::{Config, Context, Editor, ExternalPrinter as _, Helper};
use terminal::output;
use tokio::sync::mpsc as channel;

use super::completion::CompletionWords;
use crate::hosting;

/// The text that the prompt shows before the line that the user types.
const PROMPT: &str = "althing> ";

/// Number of lines of the history that are kept for later sessions.
const HISTORY_LINES_MAX: usize = 1_000;

/// Time in which the remaining output must be printed when the prompt closes.
const PRINTED_WITHIN: Duration = Duration::from_millis(500);

/// The result of reading a line.
pub(super) enum InputEvent {
    Line(String),
    /// The user pressed Ctrl-C: the line is discarded.
    Interrupted,
    End,
}

/// The source of the prompt's lines, which is standard input.
pub(super) struct LineSource {
    pub(super) is_terminal: bool,
    typed: channel::Receiver<InputEvent>,
    next: mpsc::Sender<()>,
    printing: Option<JoinHandle<()>>,
    /// The settings of the terminal before the prompt opened. They are restored at the end, because
    /// a read that a signal interrupts leaves the terminal in raw mode.
    before: Option<Termios>,
}

impl LineSource {
    /// Opens standard input. Nothing is read before the first call of [`LineSource::next`].
    pub(super) fn open(
        words: &Arc<RwLock<CompletionWords>>,
        ecosystem: &EcosystemId,
    ) -> LineSource {
        let is_terminal = std::io::stdin().is_terminal() && std::io::stdout().is_terminal();
        let (tell, typed) = channel::channel(1);
        let (next, wanted) = mpsc::channel();
        if !is_terminal {
            std::thread::spawn(move || read_lines(&wanted, &tell));
            return LineSource { is_terminal, typed, next, printing: None, before: None };
        }
        let before = tcgetattr(std::io::stdin()).ok();
        let mut printing = None;
        match editor(words) {
            Ok(mut editor) => {
                printing = print_above(&mut editor);
                let history = history(ecosystem);
                std::thread::spawn(move || edit_lines(editor, history, &wanted, &tell));
            }
            Err(error) => {
                output::print_note(&format!("warning: lines cannot be edited here: {error}"));
                std::thread::spawn(move || read_lines(&wanted, &tell));
            }
        }
        LineSource { is_terminal, typed, next, printing, before }
    }

    /// Requests the next line from the reading thread.
    pub(super) fn next(&self) {
        // A reading thread that has ended has already sent `InputEvent::End`.
        let _ = self.next.send(());
    }

    /// Waits for the next line. The line is read only after a call of [`LineSource::next`].
    pub(super) async fn next_event(&mut self) -> InputEvent {
        self.typed.recv().await.unwrap_or(InputEvent::End)
    }

    /// Prints the output that is not printed yet, and restores the settings of the terminal.
    pub(super) async fn close(self) {
        output::set_prompt(None);
        if let Some(printing) = self.printing {
            let printed = tokio::task::spawn_blocking(move || printing.join());
            // Output that the terminal does not accept in time is lost.
            let _ = tokio::time::timeout(PRINTED_WITHIN, printed).await;
        }
        if let Some(before) = self.before {
            let _ = tcsetattr(std::io::stdin(), OptionalActions::Now, &before);
        }
    }
}

fn read_lines(wanted: &mpsc::Receiver<()>, tell: &channel::Sender<InputEvent>) {
    let mut lines = std::io::stdin().lock().split(b'\n');
    while wanted.recv().is_ok() {
        let typed = match lines.next() {
            // A line that is not UTF-8 is rejected later as an unknown verb, and the next line is
            // read.
            Some(Ok(line)) => {
                let line = String::from_utf8_lossy(&line);
                InputEvent::Line(line.trim_end_matches('\r').to_owned())
            }
            Some(Err(error)) => {
                output::print_note(&format!("standard input cannot be read any more: {error}"));
                InputEvent::End
            }
            None => InputEvent::End,
        };
        let has_ended = matches!(typed, InputEvent::End);
        if tell.blocking_send(typed).is_err() || has_ended {
            return;
        }
    }
}

type LineEditor = Editor<Assistant, FileHistory>;

fn editor(words: &Arc<RwLock<CompletionWords>>) -> rustyline::Result<LineEditor> {
    let config = Config::builder()
        // Lines are added explicitly, because some must not be kept.
        .auto_add_history(false)
        .max_history_size(HISTORY_LINES_MAX)?
        .history_ignore_space(true)
        .completion_type(rustyline::CompletionType::List)
        .build();
    let mut editor = Editor::with_config(config)?;
    editor.set_helper(Some(Assistant { words: Arc::clone(words) }));
    Ok(editor)
}

fn edit_lines(
    mut editor: LineEditor,
    history: Option<PathBuf>,
    wanted: &mpsc::Receiver<()>,
    tell: &channel::Sender<InputEvent>,
) {
    if let Some(history) = &history {
        // The file does not exist before the first line.
        let _ = editor.load_history(history);
    }
    while wanted.recv().is_ok() {
        let typed = match editor.readline(PROMPT) {
            Ok(line) => {
                if is_remembered(&line) && editor.add_history_entry(line.as_str()).is_ok() {
                    // Written after each line, because a signal may end this process at any time.
                    if let Some(history) = &history {
                        let _ = editor.append_history(history);
                    }
                }
                InputEvent::Line(line)
            }
            Err(ReadlineError::Interrupted) => InputEvent::Interrupted,
            Err(_) => InputEvent::End,
        };
        let has_ended = matches!(typed, InputEvent::End);
        if tell.blocking_send(typed).is_err() || has_ended {
            return;
        }
    }
}

/// Whether a line is added to the history. An answer is not, because it may be a secret and the
/// history is a file.
fn is_remembered(line: &str) -> bool {
    let verb = line.split_whitespace().next().unwrap_or_default();
    verb.trim_matches(['"', '\'']) != "answer"
}

/// Returns the path of the history file, which is in this machine's state folder of the ecosystem.
fn history(ecosystem: &EcosystemId) -> Option<PathBuf> {
    let folder = DaemonId::new("prompt").ok()?;
    let folder = hosting::state_folder(ecosystem, &folder).ok()?;
    Some(folder.join("history"))
}

/// Prints all output above the line that the user edits, from now on. A separate thread passes the
/// output to the editor, because the editor accepts one text at a time, and only while it reads.
fn print_above(editor: &mut LineEditor) -> Option<JoinHandle<()>> {
    let mut printer = editor.create_external_printer().ok()?;
    let (print, printed) = mpsc::channel::<String>();
    output::set_prompt(Some(print));
    Some(std::thread::spawn(move || {
        for text in printed {
            if printer.print(text).is_err() {
                return;
            }
        }
    }))
}

/// The helper of the line editor, which provides completion and colours.
struct Assistant {
    words: Arc<RwLock<CompletionWords>>,
}

impl Helper for Assistant {}
impl Validator for Assistant {}

impl Hinter for Assistant {
    type Hint = String;
}

impl Highlighter for Assistant {
    fn highlight_prompt<'b, 's: 'b, 'p: 'b>(
        &'s self,
        prompt: &'p str,
        _default: bool,
    ) -> Cow<'b, str> {
        Cow::Owned(output::paint(output::Color::Green, prompt))
    }
}

impl Completer for Assistant {
    type Candidate = String;

    fn complete(
        &self,
        line: &str,
        position: usize,
        _context: &Context<'_>,
    ) -> rustyline::Result<(usize, Vec<String>)> {
        let words = self.words.read().unwrap_or_else(PoisonError::into_inner);
        Ok(words.complete(line.get(..position).unwrap_or(line)))
    }
}

#[cfg(test)]
mod tests {
    use super::is_remembered;

    #[test]
    fn answers_are_not_remembered() {
        for line in ["answer 1 2718", "  answer 1 2718", "\"answer\" 1 2718"] {
            assert!(!is_remembered(line), "{line}");
        }
        for line in ["goal answer", "goals", "act (answer phone-1)", ""] {
            assert!(is_remembered(line), "{line}");
        }
    }
}
