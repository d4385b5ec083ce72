//! Faults on real processes and real wires: processes killed and stopped, cables pulled, networks
//! partitioned, disks filled, files of stores torn in the middle of a write.
//!
//! In each round a person requests that a robot be at another place, and a fault strikes. The goal
//! must end: achieved, and then the robot is there in the building's own truth, or with a reason.
//! The robot never sets off more often than its ledger has commands. The ledger has no command
//! twice, and none of an older plan after one of a newer plan. At the end all daemons die and
//! return, and every Journal still has every accepted goal and its end.
//!
//! ```text
//! ALTHING_FAULTS=200 cargo test --workspace --test faults -- --nocapture
//! ```
//!
//! plays that many rounds of all kinds and prints a table. Without the number it plays one round of
//! each kind, alternating between the two flows. `ALTHING_FAULTS_OF=pieces` plays only the kinds
//! with that word.

mod support;
#[path = "support/testbed.rs"]
mod testbed;

use std::collections::VecDeque;
use std::fs::OpenOptions;
use std::io::{Seek as _, SeekFrom, Write as _};
use std::time::{Duration, Instant};

use support::network::LAN;
use testbed::{Asked, Ending, ISLAND, MACHINES, NOWHERE, ROBOT, Testbed};

type Played = Result<Ending, String>;

/// A kind of fault, with the function that plays it in the round of a given number.
struct Kind {
    what: &'static str,
    play: fn(&mut Testbed, usize) -> Played,
}

/// Number of rounds with one set of daemons. After them the Journals are compared with the accepted
/// goals; they keep the ends of 128 goals.
const ROUNDS_PER_TESTBED: usize = 50;

/// Unit in which a small disk gives space to a file, in bytes.
const PAGE_BYTES: u64 = 4_096;

const KINDS: &[Kind] = &[
    Kind { what: "SIGKILL of the acting requester", play: |bed, n| kill(bed, n, "plan-requester") },
    Kind { what: "SIGKILL of the acting executor", play: |bed, n| kill(bed, n, "plan-executor") },
    Kind { what: "SIGKILL of the actuator", play: kill_actuator },
    Kind { what: "SIGKILL of a journal that stands by", play: kill_who_stands_by },
    Kind { what: "SIGKILL of all at once", play: kill_all },
    Kind { what: "full disk of a journal", play: fill_journal },
    Kind { what: "full disk of the actuator", play: fill_actuator },
    Kind { what: "store of a journal cut off", play: |bed, n| tear_journal(bed, n, Torn::CutOff) },
    Kind {
        what: "store of a journal overwritten",
        play: |bed, n| tear_journal(bed, n, Torn::Overwritten),
    },
    Kind { what: "torn ledger of the actuator", play: tear_ledger },
    Kind { what: "SIGSTOP of the acting requester", play: |bed, n| stop(bed, n, "plan-requester") },
    Kind { what: "SIGSTOP of the acting executor", play: |bed, n| stop(bed, n, "plan-executor") },
    Kind { what: "SIGSTOP of the actuator", play: stop_actuator },
    Kind { what: "cable of the acting requester", play: |bed, n| cut(bed, n, "plan-requester") },
    Kind { what: "cable of the acting executor", play: |bed, n| cut(bed, n, "plan-executor") },
    Kind { what: "cable of the actuator", play: cut_actuator },
    Kind { what: "two pieces, the goal is pursued", play: pursue },
    Kind { what: "two pieces, the goal waits", play: wait },
];

#[test]
fn faults_on_real_processes_are_survived() {
    let asked = std::env::var("ALTHING_FAULTS").ok();
    let asked = asked.map(|text| text.parse().expect("ALTHING_FAULTS: a number"));
    let of = std::env::var("ALTHING_FAULTS_OF").unwrap_or_default();
    let kinds: Vec<_> = KINDS.iter().filter(|kind| kind.what.contains(&of)).collect();
    assert!(!kinds.is_empty(), "ALTHING_FAULTS_OF: no kind has `{of}`");
    let mut table = Table::default();
    let mut campaigns = campaigns(asked);
    while let Some((mode, rounds)) = campaigns.pop_front() {
        let Some(bed) = Testbed::open(mode) else { return };
        let rest = campaign(bed, mode, &kinds, &rounds, &mut table);
        if !rest.is_empty() {
            campaigns.push_front((mode, rest.to_vec()));
        }
    }
    table.print();
    assert!(table.failures.is_empty(), "{:#?}", table.failures);
}

/// Returns the rounds to play in each testbed, and the flow of each. Without a number every kind is
/// played once, half of them in each flow, so that both flows take the time of one.
fn campaigns(asked: Option<usize>) -> VecDeque<(&'static str, Vec<usize>)> {
    let modes = ["decentralized", "centralized"];
    let rounds: Vec<usize> = (0..asked.unwrap_or(KINDS.len())).collect();
    match asked {
        None => {
            let (even, odd) = rounds.into_iter().partition(|round| round.is_multiple_of(2));
            modes.into_iter().zip([even, odd]).collect()
        }
        Some(_) => {
            let chunks = rounds.chunks(ROUNDS_PER_TESTBED).map(<[usize]>::to_vec);
            modes.into_iter().cycle().zip(chunks).collect()
        }
    }
}

/// Plays these rounds, up to the first that fails; returns those that are left.
fn campaign<'r>(
    mut bed: Testbed,
    mode: &str,
    kinds: &[&Kind],
    rounds: &'r [usize],
    table: &mut Table,
) -> &'r [usize] {
    for (played_before, round) in rounds.iter().copied().enumerate() {
        let kind = kinds[round % kinds.len()];
        let began = Instant::now();
        let played = play(&mut bed, kind, round);
        eprintln!(
            "{round:>4} {mode:<13} {:<36} {:>6.1?}  {}",
            kind.what,
            began.elapsed(),
            told(&played)
        );
        let has_failed = played.is_err();
        if has_failed {
            eprintln!("{}", bed.dump());
        }
        table.note(round, mode, kind.what, played, began.elapsed());
        if has_failed {
            return &rounds[played_before + 1..];
        }
    }
    match bed.check_journals() {
        Ok(accepted) => table.accepted += accepted,
        Err(problem) => table.failures.push(format!("{mode}, rounds {rounds:?}: {problem}")),
    }
    &[]
}

/// Plays one round and checks what must hold in each.
fn play(bed: &mut Testbed, kind: &Kind, round: usize) -> Played {
    bed.whole()?;
    let (mark, commands) = (bed.mark(), bed.commands());
    let ending = (kind.play)(bed, round)?;
    bed.whole()?;
    let (departures, commands) = (bed.departures(mark), bed.commands() - commands);
    if departures > commands {
        return Err(format!("{departures} departures by {commands} commands: {:#?}", ending.said));
    }
    bed.check_ledger()?;
    Ok(ending)
}

fn told(played: &Played) -> String {
    match played {
        Ok(ending) if ending.is_achieved => "achieved".to_owned(),
        Ok(ending) => ending.said.last().cloned().unwrap_or_default().chars().take(120).collect(),
        Err(problem) => format!("FAILED: {problem}"),
    }
}

// === processes ===

fn kill(bed: &mut Testbed, n: usize, agent: &str) -> Played {
    let asked = bed.under_way(n)?;
    let host = bed.present.acting(agent);
    bed.site.office.kill(&host);
    let ending = achieved(bed, asked)?;
    bed.up(&host);
    Ok(ending)
}

/// No other agent can replace the robot, so the goal waits for its return.
fn kill_actuator(bed: &mut Testbed, n: usize) -> Played {
    let mut asked = bed.under_way(n)?;
    bed.site.office.kill("robot");
    asked.until("planning anew")?;
    bed.up("robot");
    bed.ended(asked)
}

fn kill_who_stands_by(bed: &mut Testbed, n: usize) -> Played {
    let asked = bed.under_way(n)?;
    let host = if bed.present.acting("plan-requester") == "alpha" { "beta" } else { "alpha" };
    bed.site.office.kill(host);
    let ending = achieved(bed, asked)?;
    bed.up(host);
    Ok(ending)
}

/// Kills all machines but the desk, where a person waits for the outcome.
fn kill_all(bed: &mut Testbed, n: usize) -> Played {
    let mut asked = bed.under_way(n)?;
    // A goal that was not accepted may be lost.
    asked.until("accepted; kept by")?;
    let hosts = &MACHINES[..5];
    hosts.iter().for_each(|host| bed.site.office.kill(host));
    hosts.iter().for_each(|host| bed.up(host));
    bed.ended(asked)
}

/// Stops the leader; a standby takes over. When the former leader continues, it is a standby.
fn stop(bed: &mut Testbed, n: usize, agent: &str) -> Played {
    let asked = bed.under_way(n)?;
    let host = bed.present.acting(agent);
    bed.site.office.signal(&host, "STOP");
    let ending = achieved(bed, asked);
    let gone = bed.present.gone(&[&host]);
    bed.site.office.signal(&host, "CONT");
    gone.and(ending)
}

fn stop_actuator(bed: &mut Testbed, n: usize) -> Played {
    let asked = bed.under_way(n)?;
    bed.site.office.signal("robot", "STOP");
    let gone = bed.present.gone(&["robot"]);
    bed.site.office.signal("robot", "CONT");
    gone?;
    bed.ended(asked)
}

// === wires ===

fn cut(bed: &mut Testbed, n: usize, agent: &str) -> Played {
    let asked = bed.under_way(n)?;
    let host = bed.present.acting(agent);
    bed.site.replug(&host, LAN, NOWHERE);
    let ending = achieved(bed, asked);
    let gone = bed.cut_off(&[&host]);
    bed.site.replug(&host, LAN, LAN);
    gone.and(ending)
}

fn cut_actuator(bed: &mut Testbed, n: usize) -> Played {
    let asked = bed.under_way(n)?;
    bed.site.replug("robot", LAN, NOWHERE);
    let gone = bed.cut_off(&["robot"]);
    bed.site.replug("robot", LAN, LAN);
    gone?;
    bed.ended(asked)
}

/// Partitions the network: one planning and one executing machine are on the other side, either the
/// leaders or the standbys. The goal is achieved before the heal.
fn pursue(bed: &mut Testbed, n: usize) -> Played {
    let asked = bed.under_way(n)?;
    let away = [other_side(bed, "plan-requester", n / 2), other_side(bed, "plan-executor", n)];
    away.iter().for_each(|host| bed.site.replug(host, LAN, ISLAND));
    let ending = achieved(bed, asked);
    let gone = bed.cut_off(&[&away[0], &away[1]]);
    away.iter().for_each(|host| bed.site.replug(host, LAN, LAN));
    gone.and(ending)
}

/// Partitions the network with two of the three Journals on the other side, so that the goal waits
/// until the heal.
fn wait(bed: &mut Testbed, n: usize) -> Played {
    let away = [other_side(bed, "plan-requester", n), "gamma".to_owned()];
    away.iter().for_each(|host| bed.site.replug(host, LAN, ISLAND));
    let cut_off = bed.cut_off(&[&away[0], &away[1]]);
    let mark = bed.mark();
    let mut asked = bed.ask(n, &["--partition", "wait"]);
    let waits = cut_off.and_then(|()| asked.until("waits for most of them"));
    let departures = bed.departures(mark);
    away.iter().for_each(|host| bed.site.replug(host, LAN, LAN));
    waits?;
    if departures > 0 {
        return Err(format!("it did not wait: {:#?}", asked.said));
    }
    bed.ended(asked)
}

/// Returns the leader's machine in even rounds, the other machine in odd rounds.
fn other_side(bed: &Testbed, agent: &str, n: usize) -> String {
    let acting = bed.present.acting(agent);
    let hosts = if agent == "plan-requester" { ["alpha", "beta"] } else { ["gamma", "delta"] };
    let other = hosts.into_iter().find(|host| *host != acting).unwrap_or(hosts[0]);
    if n.is_multiple_of(2) { acting } else { other.to_owned() }
}

// === disks ===

/// The goal is kept by the other Journals and the report says so. When there is room again, all
/// keep the next goal.
fn fill_journal(bed: &mut Testbed, n: usize) -> Played {
    fill(bed, "alpha");
    let mut asked = bed.ask(n, &[]);
    let accepted = asked.until("accepted; kept by");
    let ending = accepted.and_then(|()| achieved(bed, asked));
    make_room(bed, "alpha");
    let ending = ending?;
    let after = bed.ask(n + 1, &[]);
    let kept = achieved(bed, after)?;
    bed.until_kept_by_all(&kept)?;
    Ok(ending)
}

/// An actuator does not act if it cannot write its ledger. It acts when there is room again.
fn fill_actuator(bed: &mut Testbed, n: usize) -> Played {
    // Empty lines fill the ledger's last page, which would have room for a few commands.
    let ledger = bed.kept("robot", &format!("{ROBOT}.tokens"));
    let padded = OpenOptions::new().append(true).create(true).open(ledger).and_then(|mut file| {
        let used = file.metadata()?.len() % PAGE_BYTES;
        file.write_all(&vec![b'\n'; usize::try_from(PAGE_BYTES - used).unwrap_or(0)])
    });
    padded.map_err(|error| error.to_string())?;
    fill(bed, "robot");
    let mark = bed.mark();
    let mut asked = bed.ask(n, &[]);
    let refused = asked.until("planning anew");
    let departures = bed.departures(mark);
    make_room(bed, "robot");
    refused?;
    if departures > 0 {
        return Err(format!("it moved, and cannot know it: {:#?}", asked.said));
    }
    bed.ended(asked)
}

fn fill(bed: &Testbed, machine: &str) {
    let fill = bed.kept(machine, "fill");
    let mut file = std::fs::File::create(fill).expect("there is room yet");
    // Until the disk is full: first in large pieces, then in small ones.
    for length in [65_536, 512, 1] {
        while file.write_all(&vec![0; length]).is_ok() {}
    }
}

fn make_room(bed: &Testbed, machine: &str) {
    std::fs::remove_file(bed.kept(machine, "fill")).expect("it is there");
}

/// How a Journal's file is damaged while its process is dead.
enum Torn {
    CutOff,
    /// Overwritten in the middle.
    Overwritten,
}

/// Damages the file of a Journal while its process is dead.
fn tear_journal(bed: &mut Testbed, n: usize, torn: Torn) -> Played {
    let asked = bed.under_way(n)?;
    bed.site.office.kill("alpha");
    let path = bed.kept("alpha", "journal-alpha.redb");
    let mut file = OpenOptions::new().write(true).open(&path).map_err(|error| error.to_string())?;
    let length = file.metadata().map_err(|error| error.to_string())?.len();
    // At another place in each round.
    let at = length / 16 * (1 + n as u64 * 7 % 14);
    let torn = match torn {
        Torn::CutOff => file.set_len(at),
        Torn::Overwritten => {
            file.seek(SeekFrom::Start(at)).and_then(|_| file.write_all(&[0xa5; 9_000]))
        }
    };
    torn.map_err(|error| error.to_string())?;
    drop(file);
    bed.up("alpha");
    achieved(bed, asked)
}

/// Leaves half a line in the ledger, as if the process had died in the middle of a write.
fn tear_ledger(bed: &mut Testbed, n: usize) -> Played {
    let mut asked = bed.under_way(n)?;
    bed.site.office.kill("robot");
    asked.until("planning anew")?;
    let path = bed.kept("robot", &format!("{ROBOT}.tokens"));
    let file = OpenOptions::new().append(true).open(&path);
    let torn = file.and_then(|mut file| file.write_all(b"{\"begun\":{\"epoch\":17,\"conver"));
    torn.map_err(|error| format!("{}: {error}", path.display()))?;
    bed.up("robot");
    bed.ended(asked)
}

// === judging ===

/// Requires that the goal is achieved, because no fault hit the robot.
fn achieved(bed: &mut Testbed, asked: Asked) -> Played {
    let ending = bed.ended(asked)?;
    if ending.is_achieved { Ok(ending) } else { Err(format!("not achieved: {:#?}", ending.said)) }
}

/// Results of the rounds, by kind.
#[derive(Default)]
struct Table {
    rows: Vec<Row>,
    accepted: usize,
    failures: Vec<String>,
}

struct Row {
    what: &'static str,
    achieved: usize,
    told_why: usize,
    failed: usize,
    longest: Duration,
}

impl Table {
    fn note(
        &mut self,
        round: usize,
        mode: &str,
        what: &'static str,
        played: Played,
        took: Duration,
    ) {
        let at = self.rows.iter().position(|row| row.what == what).unwrap_or_else(|| {
            let longest = Duration::ZERO;
            self.rows.push(Row { what, achieved: 0, told_why: 0, failed: 0, longest });
            self.rows.len() - 1
        });
        let row = &mut self.rows[at];
        row.longest = row.longest.max(took);
        match played {
            Ok(Ending { is_achieved: true, .. }) => row.achieved += 1,
            Ok(_) => row.told_why += 1,
            Err(problem) => {
                row.failed += 1;
                self.failures.push(format!("round {round}, {mode}, {what}: {problem}"));
            }
        }
    }

    fn print(&self) {
        println!(
            "\n{:<38} {:>8} {:>8} {:>8} {:>9}",
            "fault", "achieved", "told why", "failed", "longest"
        );
        for Row { what, achieved, told_why, failed, longest } in &self.rows {
            println!("{what:<38} {achieved:>8} {told_why:>8} {failed:>8} {longest:>9.1?}");
        }
        let sum = |count: fn(&Row) -> usize| self.rows.iter().map(count).sum::<usize>();
        let survived = sum(|row| row.achieved) + sum(|row| row.told_why);
        println!(
            "{survived} faults survived, {} not; {} accepted goals are in every Journal with their end",
            sum(|row| row.failed),
            self.accepted
        );
    }
}
