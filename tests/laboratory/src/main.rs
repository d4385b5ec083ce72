//! `laboratory`: plays seeds, and reports which of them fail.

use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{OnceLock, mpsc};
use std::time::Instant;

use clap::Parser;
use laboratory::{Safeguard, TrialError, TrialResult, play, play_with_history, play_with_stop};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::FormatTime;

/// Plays whole ecosystems under faults that a seed decides.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    /// How many seeds to play.
    #[arg(long, default_value_t = 100)]
    seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 0)]
    from: u64,
    /// Replay one seed and print its history. RUST_LOG=info prints the logs of its agents, too.
    #[arg(long, value_name = "SEED")]
    replay: Option<u64>,
    /// Disable one guarantee: some seed should fail.
    #[arg(long, value_name = "GUARD")]
    without: Option<Safeguard>,
    /// A person stops everything in the midst of the faults: no device may begin anything then.
    #[arg(long)]
    stop: bool,
    /// An agent keeps the history: each chain of causes must be complete.
    #[arg(long, conflicts_with_all = ["stop", "without"])]
    history: bool,
    /// Go on after the first seed that fails.
    #[arg(long)]
    all: bool,
    /// How many seeds to play in parallel [default: one per core]
    #[arg(long)]
    jobs: Option<usize>,
}

impl Arguments {
    fn play(&self, seed: u64) -> Result<TrialResult, TrialError> {
        if self.history {
            return play_with_history(seed);
        }
        let play = if self.stop { play_with_stop } else { play };
        play(seed, self.without)
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if let Some(seed) = arguments.replay {
        return replay(seed, &arguments);
    }
    let began = Instant::now();
    let (played, failed) = play_all(&arguments);
    let (took, count) = (began.elapsed(), failed.len());
    let Some(first) = failed.first() else {
        println!("{played} seeds played in {took:.1?}, 0 failed");
        return ExitCode::SUCCESS;
    };
    println!("{played} seeds played in {took:.1?}, {count} failed: {failed:?}");
    println!("play one again: cargo run --release -p laboratory -- --replay {first}");
    ExitCode::FAILURE
}

/// Plays one seed and prints its whole history.
fn replay(seed: u64, arguments: &Arguments) -> ExitCode {
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_writer(std::io::stderr)
        .with_timer(OwnTime(OnceLock::new()))
        .init();
    match arguments.play(seed) {
        Ok(verdict) => {
            verdict.transcript.iter().for_each(|line| println!("{line}"));
            print_result(&verdict);
            let TrialResult { effects, goals, digest, lasted, .. } = verdict;
            let kinds = effects.kinds().map(|(kind, count)| format!("{count} {kind}")).join(", ");
            println!(
                "{} faults took effect; of {} messages: {kinds}",
                effects.struck, effects.message_faults.sent
            );
            println!("{goals:?}; {lasted:.1?} of simulated time; digest {digest:016x}");
            if verdict.broken.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
        }
        Err(error) => {
            eprintln!("failed to {error}");
            ExitCode::FAILURE
        }
    }
}

/// Log timestamps in the time of the trial, since its first line.
struct OwnTime(OnceLock<tokio::time::Instant>);

impl FormatTime for OwnTime {
    fn format_time(&self, writer: &mut Writer<'_>) -> std::fmt::Result {
        let since = self.0.get_or_init(tokio::time::Instant::now).elapsed();
        write!(writer, "{:>9.3}", since.as_secs_f64())
    }
}

/// Plays the seeds on all cores. Returns how many were played, and which failed. A seed that could
/// not be played counts as failed: its result is unknown.
fn play_all(arguments: &Arguments) -> (u64, Vec<u64>) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let (next, last) = (AtomicU64::new(arguments.from), arguments.from + arguments.seeds);
    let (tell_verdict, verdicts) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs.unwrap_or(cores) {
            let (tell_verdict, next) = (tell_verdict.clone(), &next);
            scope.spawn(move || {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= last {
                        return;
                    }
                    let played = arguments.play(seed);
                    if tell_verdict.send((seed, played)).is_err() {
                        return;
                    }
                }
            });
        }
        drop(tell_verdict);
        let (mut played, mut failed) = (0, Vec::new());
        while let Ok((seed, verdict)) = verdicts.recv() {
            played += 1;
            match verdict {
                Ok(verdict) if verdict.broken.is_empty() => (),
                Ok(verdict) => {
                    print_result(&verdict);
                    failed.push(seed);
                }
                Err(error) => {
                    println!("seed {seed}: failed to {error}");
                    failed.push(seed);
                }
            }
            if played % 500 == 0 {
                eprintln!("{played} of {} played, {} failed", arguments.seeds, failed.len());
            }
            if !failed.is_empty() && !arguments.all {
                break;
            }
        }
        drop(verdicts);
        failed.sort_unstable();
        (played, failed)
    })
}

fn print_result(verdict: &TrialResult) {
    let TrialResult { seed, broken, size: [daemons, agents, goals, faults], .. } = verdict;
    let what = format!("{daemons} daemons, {agents} agents, {goals} goals, {faults} faults");
    if broken.is_empty() {
        println!("seed {seed} ({what}): all is well");
    }
    for line in broken {
        println!("seed {seed} ({what}): {line}");
    }
}
