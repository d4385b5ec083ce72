//! The driver `cec`: a television that this machine turns on, and has show its picture, through the
//! HDMI cable (Consumer Electronics Control).
//!
//! The driver runs `cec-ctl`, of Debian's `v4l-utils`, which speaks to the kernel. One task asks the
//! television again and again whether it is on, and listens meanwhile to what it shows.

use std::sync::Arc;
use std::time::Duration;

use programs::Program;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep, sleep_until};

use crate::cec_output::{CecOutput, NO_ADDRESS, Power};
use crate::content::Content;
use crate::player::{Player, PlayerTrouble};

/// The program, if the config names no other.
const PROGRAM: &str = "cec-ctl";

/// Name by which the television calls this machine.
const NAME: &str = "Althing";

/// The only medium of a television: the picture of this machine.
pub(crate) const THIS_MACHINE: &str = "this machine";

/// Time for which one run of the program listens, in seconds. What is heard is known after the run;
/// between two runs nothing is heard for a moment.
const LISTENING_SECONDS: u64 = 4;

/// Shortest time from the start of a run to that of the next, in case that the program ends at once.
const RUN_MIN: Duration = Duration::from_secs(1);

/// Every so many runs, all devices are asked which of them is shown. The question blocks the bus for
/// a second if none answers.
const ASKING_RUNS: u32 = 4;

/// Time limit of a run: that of listening, and of a bus on which messages are repeated.
const RUN_MAX: Duration = Duration::from_secs(12);
const _: () = assert!(RUN_MAX.as_secs() > 2 * LISTENING_SECONDS);

/// Number of questions in a row without an answer after which the television counts as gone. A
/// television that turns on or off may miss one.
const UNANSWERED_MAX: u32 = 3;

/// Time limit for a television to turn on.
const TURNING_ON_MAX: Duration = Duration::from_secs(20);

/// Pause between two questions whether the television has turned on.
const ASK_AGAIN: Duration = Duration::from_secs(1);

/// Settings of the driver `cec`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct CecSettings {
    /// The kernel's device of the cable.
    pub(crate) device: String,
    pub(crate) program: Option<String>,
}

impl CecSettings {
    /// Runs the program with these arguments on the device, and reads its output.
    async fn run(&self, arguments: &[&str]) -> Result<CecOutput, String> {
        let program = self.program.as_deref().unwrap_or(PROGRAM);
        let command = [program, "-d", &self.device].into_iter().chain(arguments.iter().copied());
        let program =
            Program::of(command.map(str::to_owned)).ok_or("run a program without a name")?;
        let output = program.run(RUN_MAX).await.map_err(|error| error.to_string())?;
        Ok(CecOutput::read(&output))
    }
}

/// What is known of the television.
#[derive(Clone, Debug, Default)]
struct TelevisionReport {
    power: Option<Power>,
    /// Place whose picture is shown; `None` if it is not known.
    shown: Option<String>,
    /// Reason why the television cannot be used; `None` if it can.
    problem: Option<String>,
    /// Number of questions in a row without an answer.
    unanswered: u32,
    /// Number of commands so far. After each, listening begins anew, because what was heard before
    /// a command does not count after it.
    commands: u32,
}

/// A television, and whether it has to show this machine.
pub(crate) struct CecPlayer {
    settings: CecSettings,
    /// Place of this machine among the inputs of the television.
    own_address: String,
    report: Arc<watch::Sender<TelevisionReport>>,
    watching: JoinHandle<()>,
    is_wanted: bool,
}

impl Player for CecPlayer {
    type Settings = CecSettings;

    async fn start(settings: &CecSettings) -> Result<CecPlayer, String> {
        let configured = settings.run(&["--playback", "--osd-name", NAME]).await?;
        let device = &settings.device;
        let own_address = configured.own_address.filter(|address| address != NO_ADDRESS);
        let own_address = own_address
            .ok_or_else(|| format!("find a television: none is plugged into {device}"))?;
        let asked = settings.run(&["-s", "-t0", "--give-device-power-status"]).await?;
        if asked.is_unanswered {
            return Err(no_answer(device));
        }
        let report = TelevisionReport { power: asked.power, ..TelevisionReport::default() };
        let report = Arc::new(watch::Sender::new(report));
        let watching = tokio::spawn(watch_television(settings.clone(), Arc::clone(&report)));
        let settings = settings.clone();
        Ok(CecPlayer { settings, own_address, report, watching, is_wanted: false })
    }

    async fn show(&mut self, content: Option<&Content>) -> Result<(), PlayerTrouble> {
        match content {
            Some(_) => self.turn_on().await,
            None => self.turn_off().await.map_err(PlayerTrouble::Program),
        }
    }

    async fn check(&mut self) -> Result<(), PlayerTrouble> {
        let report = self.report.borrow();
        if let Some(problem) = &report.problem {
            return Err(PlayerTrouble::Program(problem.clone()));
        }
        let why = match (report.power, report.shown.as_deref()) {
            _ if !self.is_wanted => return Ok(()),
            (Some(Power::Standby), _) => "it was turned off".to_owned(),
            (_, Some("0.0.0.0")) => "it shows its own program".to_owned(),
            (_, Some(place)) if place != self.own_address => format!("it shows the input {place}"),
            _ => return Ok(()),
        };
        Err(PlayerTrouble::Content(format!("have the television show this machine: {why}")))
    }

    async fn failed(&mut self) -> String {
        let mut changes = self.report.subscribe();
        let lost = changes.wait_for(|report| report.problem.is_some()).await;
        let problem = lost.ok().and_then(|report| report.problem.clone());
        problem.unwrap_or_else(|| "watch the television".to_owned())
    }

    async fn end(mut self) {
        if self.report.borrow().problem.is_none() {
            // A television that does not listen is lost already, with its reason in the log.
            let _ = self.turn_off().await;
        }
    }
}

impl Drop for CecPlayer {
    fn drop(&mut self) {
        self.watching.abort();
    }
}

impl CecPlayer {
    /// Turns the television on, and has it show this machine.
    async fn turn_on(&mut self) -> Result<(), PlayerTrouble> {
        self.is_wanted = true;
        let active = format!("phys-addr={}", self.own_address);
        let wake = ["-s", "-t0", "--image-view-on", "--active-source", &active];
        let deadline = Instant::now() + TURNING_ON_MAX;
        loop {
            self.settings.run(&wake).await.map_err(PlayerTrouble::Program)?;
            let ask = ["-s", "-t0", "--give-device-power-status"];
            let asked = self.settings.run(&ask).await.map_err(PlayerTrouble::Program)?;
            if asked.power == Some(Power::On) {
                break;
            }
            if Instant::now() >= deadline {
                let why = format!("turn the television on: it is not on after {TURNING_ON_MAX:?}");
                return Err(PlayerTrouble::Content(why));
            }
            sleep(ASK_AGAIN).await;
        }
        self.note_command(Power::On);
        Ok(())
    }

    /// Puts the television in standby, unless people watch something else on it.
    async fn turn_off(&mut self) -> Result<(), String> {
        let is_other = {
            let report = self.report.borrow();
            report.shown.as_ref().is_some_and(|place| *place != self.own_address)
        };
        if !std::mem::replace(&mut self.is_wanted, false) || is_other {
            return Ok(());
        }
        self.settings.run(&["-s", "-t0", "--standby"]).await?;
        self.note_command(Power::Standby);
        Ok(())
    }

    /// Notes the state that follows from a command.
    fn note_command(&self, power: Power) {
        self.report.send_modify(|report| {
            report.power = Some(power);
            report.shown = (power == Power::On).then(|| self.own_address.clone());
            report.commands += 1;
        });
    }
}

/// Watches a television until it cannot be used any more.
async fn watch_television(settings: CecSettings, report: Arc<watch::Sender<TelevisionReport>>) {
    let time = format!("--monitor-time={LISTENING_SECONDS}");
    let listen = ["-s", "--wait-for-msgs", &time];
    let (mut changes, mut runs) = (report.subscribe(), 0_u32);
    while report.borrow().problem.is_none() {
        let (began, commands) = (Instant::now(), report.borrow().commands);
        let mut ask = vec!["-s", "-t0", "--give-device-power-status"];
        if runs.is_multiple_of(ASKING_RUNS) {
            ask.push("--request-active-source");
        }
        runs = runs.wrapping_add(1);
        let both = async { tokio::join!(settings.run(&ask), settings.run(&listen)) };
        let (asked, heard) = tokio::select! {
            both = both => both,
            // The sender lives as long as this task.
            _ = changes.wait_for(|report| report.commands != commands) => continue,
        };
        report.send_modify(|report| {
            report.take_answer(asked, &settings.device);
            // What was heard is as late as the answer, or later.
            report.take(heard, &settings.device);
        });
        sleep_until(began + RUN_MIN).await;
    }
}

impl TelevisionReport {
    /// Takes note of the answer to the question whether the television is on.
    fn take_answer(&mut self, asked: Result<CecOutput, String>, device: &str) {
        let is_unanswered = asked.as_ref().is_ok_and(|asked| asked.is_unanswered);
        self.unanswered = if is_unanswered { self.unanswered + 1 } else { 0 };
        if self.unanswered >= UNANSWERED_MAX {
            self.problem = Some(no_answer(device));
        }
        self.take(asked, device);
    }

    /// Takes note of what a run of the program has said.
    fn take(&mut self, heard: Result<CecOutput, String>, device: &str) {
        let heard = match heard {
            Ok(heard) => heard,
            Err(problem) => {
                self.problem = Some(problem);
                return;
            }
        };
        if heard.own_address.as_deref() == Some(NO_ADDRESS) {
            self.problem = Some(format!("reach the television: it was unplugged from {device}"));
        } else if heard.is_unconfigured {
            self.problem = Some(format!("use {device}: it was set up anew"));
        }
        self.power = heard.power.or(self.power);
        self.shown = heard.shown.or(self.shown.take());
    }
}

fn no_answer(device: &str) -> String {
    format!(
        "reach the television at {device}: it does not answer; look in its settings whether CEC is \
         on, which makers call Anynet+, Bravia Sync, SimpLink, VIERA Link or HDMI control"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output(shown: Option<&str>) -> CecOutput {
        CecOutput {
            power: Some(Power::On),
            shown: shown.map(str::to_owned),
            ..CecOutput::default()
        }
    }

    #[test]
    fn what_is_not_said_again_stays_known() {
        let mut report = TelevisionReport::default();
        report.take(Ok(output(Some("2.0.0.0"))), "/dev/cec0");
        report.take(Ok(CecOutput::default()), "/dev/cec0");
        assert_eq!((report.power, report.shown.as_deref()), (Some(Power::On), Some("2.0.0.0")));
    }

    #[test]
    fn a_television_is_gone_after_three_questions_without_an_answer() {
        let silent = || Ok(CecOutput { is_unanswered: true, ..CecOutput::default() });
        let mut report = TelevisionReport::default();
        for heard in [silent(), silent(), Ok(output(None)), silent(), silent()] {
            report.take_answer(heard, "/dev/cec0");
            report.take(Ok(CecOutput::default()), "/dev/cec0");
            assert_eq!(report.problem, None);
        }
        report.take_answer(silent(), "/dev/cec0");
        assert!(report.problem.expect("it is gone").contains("whether CEC is on"));
        for (heard, expected) in [
            (CecOutput { own_address: Some(NO_ADDRESS.to_owned()), ..output(None) }, "unplugged"),
            (CecOutput { is_unconfigured: true, ..output(None) }, "set up anew"),
        ] {
            let mut report = TelevisionReport::default();
            report.take(Ok(heard), "/dev/cec0");
            assert!(report.problem.expect("it is gone").contains(expected));
        }
    }
}
