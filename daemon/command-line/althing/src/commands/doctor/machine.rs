//! Checks of the machine's clock, memory and limits.

use std::path::Path;
use std::time::{Duration, SystemTime};

use programs::Program;

use super::finding::{CheckFinding, DoctorCheck, Remedy, size};
use crate::commands::brief;
use crate::hosting;

/// How far a clock may be before the date of this program: file systems and archives round dates,
/// and have dates of other time zones.
const BEFORE_BUILD_MAX: Duration = Duration::from_secs(24 * 3_600);

/// Memory below which a daemon is likely to be killed, and below which it is short.
const MEMORY_PROBLEM: u64 = 48 << 20;
const MEMORY_NOTE: u64 = 192 << 20;

/// How long `timedatectl` may take.
const ASKED_WITHIN: Duration = Duration::from_secs(3);

/// File that systemd-timesyncd creates when it has set the clock.
const TIMESYNC_MARK: &str = "/run/systemd/timesync/synchronized";

/// Command that lets the machine set its clock by the network.
const SYNCHRONIZE: &str = "sudo timedatectl set-ntp true";

/// Checks that the clock is not before this program was built.
pub(super) fn clock() -> Vec<CheckFinding> {
    let program = std::fs::metadata("/proc/self/exe").and_then(|about| about.modified());
    vec![match program {
        Ok(built) => clock_finding(SystemTime::now(), built),
        Err(error) => {
            DoctorCheck::Clock.note(format!("the date of this program is not known: {error}"), None)
        }
    }]
}

fn clock_finding(now: SystemTime, built: SystemTime) -> CheckFinding {
    let check = DoctorCheck::Clock;
    let date = |time: SystemTime| {
        let read = jiff::Timestamp::try_from(time);
        read.map_or_else(|_| "far away".to_owned(), |time| time.strftime("%F %T UTC").to_string())
    };
    match built.duration_since(now) {
        Ok(before) if before > BEFORE_BUILD_MAX => check.problem(
            format!(
                "the clock says {}, and this program was built at {}: certificates count as not \
                 valid yet",
                date(now),
                date(built)
            ),
            Remedy::mend(SYNCHRONIZE),
        ),
        _ => check.ok(date(now)),
    }
}

/// Checks whether the clock is set by the network.
pub(super) fn clock_sync() -> Vec<CheckFinding> {
    let check = DoctorCheck::ClockSync;
    if Path::new(TIMESYNC_MARK).exists() {
        return vec![check.ok("the network sets the clock (systemd-timesyncd)")];
    }
    vec![match ask_timedatectl() {
        Ok(answer) => sync_finding(&answer),
        Err(why) => check.note(format!("it is not known whether the network sets it: {why}"), None),
    }]
}

fn ask_timedatectl() -> Result<String, String> {
    let words = ["timedatectl", "show", "--property=NTPSynchronized", "--value"];
    let program = Program::of(words.map(str::to_owned));
    let program = program.expect("invariant: the list is not empty");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| error.to_string())?;
    runtime.block_on(program.run(ASKED_WITHIN)).map_err(|error| format!("failed to {error}"))
}

fn sync_finding(answer: &str) -> CheckFinding {
    let check = DoctorCheck::ClockSync;
    match answer.trim() {
        "yes" => check.ok("the network sets the clock"),
        "no" => check.problem(
            "the network does not set the clock: the clocks of daemons drift apart",
            Remedy::mend(SYNCHRONIZE),
        ),
        other => check.note(format!("timedatectl says `{other}`"), Remedy::look("timedatectl")),
    }
}

/// Checks the memory that this machine can still give.
pub(super) fn memory() -> Vec<CheckFinding> {
    vec![memory_finding(machine::memory_available(), machine::memory_total())]
}

fn memory_finding(available: Option<u64>, total: Option<u64>) -> CheckFinding {
    let check = DoctorCheck::Memory;
    let Some(available) = available else {
        return check.note("the kernel does not say how much memory is left", None);
    };
    let of = total.map(|total| format!(" of {}", size(total))).unwrap_or_default();
    let text = format!("{}{of} available", size(available));
    let look = Remedy::look("ps -eo rss,pid,comm --sort=-rss | head");
    match available {
        0..MEMORY_PROBLEM => check.problem(format!("only {text}: the kernel may kill it"), look),
        MEMORY_PROBLEM..MEMORY_NOTE => check.note(text, look),
        _ => check.ok(text),
    }
}

/// Checks the limit on open files of this user.
pub(super) fn open_files() -> Vec<CheckFinding> {
    let (limit, most) = hosting::open_files_limit();
    vec![open_files_finding(limit, most)]
}

fn open_files_finding(limit: u64, most: u64) -> CheckFinding {
    let (check, needed) = (DoctorCheck::OpenFiles, hosting::OPEN_FILES_NEEDED);
    if limit >= needed {
        return check.ok(format!("{limit} files may be open"));
    }
    let mend = match most >= needed {
        true => format!("ulimit -n {needed}"),
        // `$$` is the shell of the person, from which the daemon is started.
        false => format!("sudo prlimit --pid $$ --nofile={needed}:{needed}"),
    };
    let text = format!(
        "only {limit} files may be open, connections among them; a daemon needs {needed} (in a \
         service: LimitNOFILE={needed})"
    );
    check.problem(text, Remedy::mend(mend))
}

/// Returns the sentence about the difference of a clock to this machine's.
pub(super) fn clock_difference(ahead: bool, by: Duration) -> String {
    format!("{} {}", brief(by), if ahead { "ahead" } else { "behind" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::doctor::finding::CheckVerdict;

    #[test]
    fn a_clock_before_the_program_is_a_problem() {
        let built = SystemTime::UNIX_EPOCH + Duration::from_secs(1_800_000_000);
        assert_eq!(clock_finding(built, built).verdict, CheckVerdict::Ok);
        let hour_before = built - Duration::from_secs(3_600);
        assert_eq!(clock_finding(hour_before, built).verdict, CheckVerdict::Ok);
        let early = clock_finding(SystemTime::UNIX_EPOCH, built);
        assert_eq!(early.verdict, CheckVerdict::Problem);
        assert!(early.text.contains("1970-01-01"), "{}", early.text);
        assert!(early.remedy.is_some());
    }

    #[test]
    fn an_unsynchronized_clock_is_a_problem_and_an_unknown_one_a_note() {
        assert_eq!(sync_finding("yes\n").verdict, CheckVerdict::Ok);
        assert_eq!(sync_finding("no\n").verdict, CheckVerdict::Problem);
        assert_eq!(sync_finding("").verdict, CheckVerdict::Note);
    }

    #[test]
    fn little_memory_is_a_note_and_then_a_problem() {
        assert_eq!(memory_finding(Some(1 << 30), None).verdict, CheckVerdict::Ok);
        assert_eq!(memory_finding(Some(100 << 20), None).verdict, CheckVerdict::Note);
        assert_eq!(memory_finding(Some(1 << 20), Some(1 << 30)).verdict, CheckVerdict::Problem);
        assert_eq!(memory_finding(None, None).verdict, CheckVerdict::Note);
    }

    #[test]
    fn a_low_limit_has_the_command_that_this_user_may_run() {
        assert_eq!(open_files_finding(1_024, 4_096).verdict, CheckVerdict::Ok);
        let low = open_files_finding(64, 4_096);
        assert_eq!(low.remedy, Remedy::mend("ulimit -n 512"));
        let hard = open_files_finding(64, 64);
        assert!(matches!(&hard.remedy, Some(Remedy::Mend(it)) if it.starts_with("sudo prlimit")));
    }
}
