//! Recordings of a video stream by `ffmpeg`, which copies the video without decoding it.
//!
//! - The address with its password reaches `ffmpeg` over a pipe, because all users of a machine can
//!   read the arguments of its programs.
//! - A recording has a maximum length and size. One that breaks off is an error, and no recording.
//! - Sound is not recorded.

use std::time::Duration;

use onvif_link::VideoStream;
use programs::{Program, ProgramError, ProgramStart, RunningProgram, is_installed};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::UnixStream;
use tokio::time::Instant;

use crate::driver::{FileContent, PartFile, RecordedFile};
use crate::lines::Lines;

/// Name of the program.
const FFMPEG: &str = "ffmpeg";

/// Time for the camera to begin to send, and for the program to finish the file.
pub(crate) const START_TIME_MAX: Duration = Duration::from_secs(15);

/// Maximum size of a recording, in bytes: a minute of 16 Mbit/s, twice as much as cameras with
/// eight megapixels usually send.
const BYTES_MAX: u64 = 120_000_000;

/// Part of the wanted length that may be missing: the time between two pictures of a slow camera.
const MISSING_MAX: Duration = Duration::from_millis(500);

/// Maximum length of a line in which `ffmpeg` reports its progress, in bytes.
const LINE_BYTES_MAX: usize = 256;

/// Whether videos can be recorded on this machine.
pub(crate) fn is_possible() -> bool {
    is_installed(FFMPEG)
}

/// Records a video of the length `lasts` into `part`. Returns an error that completes “failed to …”
/// if the recording is not complete. Dropping the future ends the program.
pub(crate) async fn record(
    stream: &VideoStream,
    lasts: Duration,
    part: PartFile,
) -> Result<RecordedFile, String> {
    let began = Instant::now();
    let arguments = arguments(lasts, &part);
    let program = Program::of(arguments).ok_or("record a video without a program")?;
    let started = program.start(ProgramStart::default());
    let (mut running, link) = started.map_err(|error| error.to_string())?;
    let (script, within) = (script(&stream.secret_address()), lasts + START_TIME_MAX);
    let ended = tokio::time::timeout(within, follow(&mut running, link, &script)).await;
    running.end().await;
    let failed = |problem: String| format!("record {}: {problem}", stream.address());
    let progress = match ended {
        Ok(progress) => progress.map_err(|problem| failed(without_addresses(&problem)))?,
        Err(_) => {
            let problem = format!("the camera did not send {lasts:?} of video within {within:?}");
            return Err(failed(problem));
        }
    };
    progress.check(lasts, began.elapsed()).map_err(failed)?;
    let caption = progress.caption();
    Ok(RecordedFile { extension: "mp4", content: FileContent::Written(part), caption })
}

/// Returns the program with its arguments. It reads the address from its file descriptor 3, and
/// reports its progress on 4.
fn arguments(lasts: Duration, part: &PartFile) -> Vec<String> {
    let (lasts, bytes) = (format!("{:.3}", lasts.as_secs_f64()), BYTES_MAX.to_string());
    let file = format!("file:{}", part.path().display());
    let arguments = [
        FFMPEG,
        "-hide_banner",
        "-nostdin",
        "-loglevel",
        "error",
        "-f",
        "concat",
        "-safe",
        "0",
        "-protocol_whitelist",
        "pipe,rtsp,rtp,udp,tcp",
        "-i",
        "pipe:3",
        "-map",
        "0:v:0",
        "-c",
        "copy",
        "-t",
        &lasts,
        "-fs",
        &bytes,
        "-movflags",
        "+faststart",
        "-progress",
        "pipe:4",
        "-f",
        "mp4",
        &file,
    ];
    arguments.map(str::to_owned).to_vec()
}

/// Returns the script that names the input: a list of one video (ffmpeg's “concat demuxer”). TCP
/// keeps pictures whole on a bad network.
fn script(address: &str) -> String {
    format!("ffconcat version 1.0\nfile '{address}'\noption rtsp_transport tcp\n")
}

/// Gives the program its script, and follows it to its end.
async fn follow(
    running: &mut RunningProgram,
    mut link: UnixStream,
    script: &str,
) -> Result<RecordingProgress, String> {
    // If the program has ended, its end has the reason.
    let _ = link.write_all(script.as_bytes()).await;
    let _ = link.shutdown().await;
    let (mut progress, mut lines) = (RecordingProgress::default(), Lines::new(LINE_BYTES_MAX));
    let mut piece = [0; 4_096];
    while let Ok(count @ 1..) = link.read(&mut piece).await {
        for line in lines.take(piece.get(..count).unwrap_or_default()) {
            progress.note(&line);
        }
    }
    match running.ended().await {
        ProgramError::Failed { status, .. } if status.success() => Ok(progress),
        error => Err(error.to_string()),
    }
}

/// Progress of a recording, as `ffmpeg` reports it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct RecordingProgress {
    length: Duration,
    bytes: u64,
    /// Whether the file was finished.
    has_ended: bool,
}

impl RecordingProgress {
    /// Takes a line `key=value` of a report. Numbers that are not known yet are `N/A`.
    fn note(&mut self, line: &str) {
        match line.split_once('=') {
            Some(("out_time_us", value)) => {
                let length = value.trim().parse().map(Duration::from_micros);
                self.length = length.unwrap_or(self.length);
            }
            Some(("total_size", value)) => self.bytes = value.trim().parse().unwrap_or(self.bytes),
            Some(("progress", value)) => self.has_ended = value.trim() == "end",
            _ => (),
        }
    }

    /// Checks whether a recording of the length `lasts` that took the time `elapsed` is complete.
    ///
    /// A recording begins with the first whole picture, which cameras send every few seconds. So it
    /// may be shorter if it took the time.
    fn check(&self, lasts: Duration, elapsed: Duration) -> Result<(), String> {
        if !self.has_ended || self.bytes == 0 {
            return Err("the camera sends no video".to_owned());
        }
        let is_whole = self.length + MISSING_MAX >= lasts;
        let is_late = elapsed >= lasts && self.length >= lasts / 2;
        if is_whole || is_late {
            return Ok(());
        }
        if self.bytes >= BYTES_MAX / 10 * 9 {
            return Err(format!(
                "it has reached {} MB after {:.1?}; shorten `record-seconds`, or lower the quality \
                 in the camera's settings",
                BYTES_MAX / 1_000_000,
                self.length
            ));
        }
        Err(format!("it broke off after {:.1?} of {lasts:?}", self.length))
    }

    fn caption(&self) -> String {
        format!("{:.1} s, {} kB", self.length.as_secs_f64(), self.bytes.div_ceil(1_000))
    }
}

/// Returns a text of a program without the words that contain an address, because an address may
/// contain a password.
pub(crate) fn without_addresses(text: &str) -> String {
    let word = |word: &str| if word.contains("://") { "…".to_owned() } else { word.to_owned() };
    text.split_whitespace().map(word).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIVE: Duration = Duration::from_secs(5);

    fn progress(lines: &[&str]) -> RecordingProgress {
        let mut progress = RecordingProgress::default();
        lines.iter().for_each(|line| progress.note(line));
        progress
    }

    #[test]
    fn a_recording_that_broke_off_is_none() {
        let begun = ["out_time_us=N/A", "total_size=48", "progress=continue", "fps=0.00", "x"];
        let seconds = |seconds: u64| Duration::from_secs(seconds);
        for (end, elapsed, expected) in [
            (["out_time_us=4960000", "total_size=900000", "progress=end"], 5, None),
            (["out_time_us=4960000", "total_size=900000", "progress=end"], 2, None),
            (["out_time_us=3100000", "total_size=900000", "progress=end"], 6, None),
            (
                ["out_time_us=3100000", "total_size=900000", "progress=end"],
                4,
                Some("broke off after 3.1s of 5s"),
            ),
            (
                ["out_time_us=1100000", "total_size=900000", "progress=end"],
                9,
                Some("broke off after 1.1s of 5s"),
            ),
            (
                ["out_time_us=4960000", "total_size=900000", "progress=continue"],
                5,
                Some("sends no video"),
            ),
            (["out_time_us=N/A", "total_size=0", "progress=end"], 5, Some("sends no video")),
            (
                ["out_time_us=2000000", "total_size=119999000", "progress=end"],
                2,
                Some("reached 120 MB after 2.0s"),
            ),
        ] {
            let lines: Vec<_> = begun.iter().chain(&end).copied().collect();
            let checked = progress(&lines).check(FIVE, seconds(elapsed));
            match (checked, expected) {
                (Ok(()), None) => (),
                (Err(problem), Some(expected)) if problem.contains(expected) => (),
                (checked, _) => panic!("{end:?}: {checked:?}"),
            }
        }
        let done = progress(&["out_time_us=4960000", "total_size=900001", "progress=end"]);
        assert_eq!(done.caption(), "5.0 s, 901 kB");
    }

    #[test]
    fn words_with_an_address_are_left_out() {
        let said = "[rtsp @ 0x5] rtsp://me:hunter2@cam/1: Connection refused";
        assert_eq!(without_addresses(said), "[rtsp @ 0x5] … Connection refused");
    }
}
