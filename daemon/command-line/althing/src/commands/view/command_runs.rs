//! Runs commands of this program for the screen, each as a process of its own: a goal, an answer,
//! a stop. The output is shown on the screen; the screen never waits for it.

use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWriteExt as _};
use tokio::process::{Child, Command};
use tokio::runtime::Handle;
use tokio::sync::Mutex;
use tokio::task::JoinSet;

use super::view_inbox::{CommandOutput, ScreenInput, ViewInbox};
use crate::cli::ReachArgs;

/// Maximum number of commands that run at a time.
const RUNNING_MAX: usize = 8;

/// Maximum length of the output that is shown, in bytes. The rest is read and dropped.
const OUTPUT_BYTES_MAX: usize = 64 << 10;

/// How long a command runs until its output so far is shown. Most commands take less; one that
/// follows a goal takes as long as the goal.
const SHOWN_AFTER: Duration = Duration::from_secs(3);

/// The commands that were started from the screen. They end when this value is dropped.
pub(super) struct CommandRuns {
    runtime: Handle,
    inbox: Arc<ViewInbox>,
    /// The options that name the ecosystem, which each command gets.
    reach: Vec<String>,
    running: Arc<AtomicUsize>,
}

impl CommandRuns {
    pub(super) fn new(runtime: Handle, inbox: Arc<ViewInbox>, reach: &ReachArgs) -> CommandRuns {
        CommandRuns { runtime, inbox, reach: reach_options(reach), running: Arc::default() }
    }

    /// Starts a command. `input` is given to its standard input, so that an answer of a person is
    /// in no list of processes.
    pub(super) fn start(&self, arguments: &[String], input: Option<String>) {
        let title = format!("althing {}", arguments.join(" "));
        if self.running.fetch_add(1, Ordering::Relaxed) >= RUNNING_MAX {
            self.running.fetch_sub(1, Ordering::Relaxed);
            let text = format!("{RUNNING_MAX} commands are running already; wait for one of them");
            let output = CommandOutput { title, text, succeeded: false };
            return self.inbox.push_input(ScreenInput::Output(output));
        }
        let arguments = [arguments, &self.reach].concat();
        let (inbox, running) = (Arc::clone(&self.inbox), Arc::clone(&self.running));
        self.runtime.spawn(async move {
            run(title, &arguments, input, &inbox).await;
            running.fetch_sub(1, Ordering::Relaxed);
        });
    }
}

/// Returns the options that name the ecosystem, as separate words of a command line.
fn reach_options(reach: &ReachArgs) -> Vec<String> {
    let ReachArgs { ecosystem, connect, key } = reach;
    let ecosystem = ecosystem.iter().map(|each| ("--ecosystem", each));
    let connect = connect.iter().map(|each| ("--connect", each));
    let key = key.iter().map(|each| ("--as", each));
    let options = ecosystem.chain(connect).chain(key);
    options.flat_map(|(option, value)| [option.to_owned(), value.clone()]).collect()
}

async fn run(title: String, arguments: &[String], input: Option<String>, inbox: &ViewInbox) {
    let show = |text: String, succeeded| {
        let output = CommandOutput { title: title.clone(), text, succeeded };
        inbox.push_input(ScreenInput::Output(output));
    };
    let mut child = match spawn(arguments, input.is_some()) {
        Ok(child) => child,
        Err(problem) => return show(format!("the command did not start: {problem}"), false),
    };
    let text = Arc::new(Mutex::new(String::new()));
    let mut readers = JoinSet::new();
    if let (Some(mut stdin), Some(input)) = (child.stdin.take(), input) {
        // A command that does not read its input tells why in its output.
        readers.spawn(async move { drop(stdin.write_all(format!("{input}\n").as_bytes()).await) });
    }
    child.stdout.take().into_iter().for_each(|out| drop(readers.spawn(read(out, text.clone()))));
    child.stderr.take().into_iter().for_each(|out| drop(readers.spawn(read(out, text.clone()))));
    let mut ended = Box::pin(async {
        while readers.join_next().await.is_some() {}
        child.wait().await
    });
    if let Ok(status) = tokio::time::timeout(SHOWN_AFTER, &mut ended).await {
        let succeeded = status.is_ok_and(|status| status.success());
        return show(text.lock().await.clone(), succeeded);
    }
    let so_far = text.lock().await.clone();
    show(format!("{so_far}\n(the command goes on; its end is shown here)"), true);
    let succeeded = ended.await.is_ok_and(|status| status.success());
    show(text.lock().await.clone(), succeeded);
}

fn spawn(arguments: &[String], has_input: bool) -> std::io::Result<Child> {
    Command::new(std::env::current_exe()?)
        .args(arguments)
        .env("NO_COLOR", "1")
        .stdin(if has_input { Stdio::piped() } else { Stdio::null() })
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .kill_on_drop(true)
        .spawn()
}

/// Adds the output of a command to `text`, up to the maximum length.
async fn read(mut output: impl AsyncRead + Unpin, text: Arc<Mutex<String>>) {
    let mut bytes = vec![0; 4 << 10];
    while let Ok(count @ 1..) = output.read(&mut bytes).await {
        let mut text = text.lock().await;
        if text.len() < OUTPUT_BYTES_MAX {
            text.push_str(&String::from_utf8_lossy(&bytes[..count]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_told_the_ecosystem() {
        let reach = ReachArgs {
            ecosystem: Some("my office.toml".to_owned()),
            connect: vec!["tls/a:1".to_owned(), "tls/b:1".to_owned()],
            key: Some("me".to_owned()),
        };
        let expected = "--ecosystem|my office.toml|--connect|tls/a:1|--connect|tls/b:1|--as|me";
        assert_eq!(reach_options(&reach).join("|"), expected);
    }

    #[tokio::test]
    async fn a_long_output_is_cut() {
        let long = vec![b'x'; 3 * OUTPUT_BYTES_MAX];
        let text = Arc::new(Mutex::new(String::new()));
        read(&long[..], Arc::clone(&text)).await;
        let length = text.lock().await.len();
        assert!((OUTPUT_BYTES_MAX..OUTPUT_BYTES_MAX + (4 << 10)).contains(&length), "{length}");
    }
}
