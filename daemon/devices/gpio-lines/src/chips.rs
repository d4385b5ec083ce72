//! GPIO chips of this machine, from their files below `/dev`.

use std::io;
use std::path::{Path, PathBuf};

use gpiocdev::chip::Chip;
use gpiocdev::line::{EdgeDetection, EdgeKind, Value};
use gpiocdev::request::{Config, Request};
use tokio::io::unix::AsyncFd;

use crate::{
    Bias, BoxFuture, GpioBoard, InputLine, InputSettings, LineError, LineName, OutputLine,
    OutputSettings,
};

/// Name of the user of a line that the kernel lists for the lines of this crate.
const CONSUMER: &str = "althing";

/// Maximum number of edges that are read at one time; further edges are read the next time. The
/// kernel keeps 16 edges for a line.
const EDGES_MAX: usize = 16;

/// GPIO chips of this machine, with their files below one folder. The folder is `/dev`, or another
/// one in which the files are visible in a container.
#[derive(Clone, Debug)]
pub struct GpioChips {
    folder: PathBuf,
}

/// Chip and number of an existing line.
struct LinePosition {
    chip: PathBuf,
    number: u32,
    /// Name of the line for messages.
    name: String,
}

impl Default for GpioChips {
    fn default() -> GpioChips {
        GpioChips::new("/dev")
    }
}

impl GpioChips {
    /// Returns the chips with their files below `folder`.
    pub fn new(folder: impl Into<PathBuf>) -> GpioChips {
        GpioChips { folder: folder.into() }
    }

    /// Returns the paths of the files of all chips, sorted by name.
    fn files(&self) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(&self.folder).into_iter().flatten();
        let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
        let is_chip = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str());
            name.is_some_and(|name| name.starts_with("gpiochip"))
                && gpiocdev::chip::is_chip(path).is_ok()
        };
        let mut files: Vec<_> = paths.filter(is_chip).collect();
        files.sort_by(|one, other| gpiocdev::chip::path_compare(one, other));
        files
    }

    /// Returns the chips that this process has permission to open.
    fn open_all(&self) -> Vec<Chip> {
        self.files().into_iter().filter_map(|path| open(&path).ok()).collect()
    }

    /// Returns the names of the chips that can be opened, with their labels, for messages.
    fn known(&self) -> Vec<String> {
        let told = |chip: Chip| {
            let label = label(&chip).unwrap_or_default();
            let name = chip.name();
            if label.is_empty() { name } else { format!("{name} ({label})") }
        };
        self.open_all().into_iter().map(told).collect()
    }

    fn find(&self, line: &LineName) -> Result<LinePosition, LineError> {
        match line {
            LineName::Numbered { chip, number } => self.find_number(chip, *number),
            LineName::Named(name) => self.find_name(name),
        }
    }

    fn find_number(&self, wanted: &str, number: u32) -> Result<LinePosition, LineError> {
        let path = self.folder.join(wanted);
        let chip = if gpiocdev::chip::is_chip(&path).is_ok() {
            open(&path)?
        } else {
            let labeled = self.open_all().into_iter();
            let mut labeled = labeled.filter(|chip| label(chip).as_deref() == Some(wanted));
            labeled.next().ok_or_else(|| LineError::NoChip {
                wanted: wanted.to_owned(),
                known: self.known(),
            })?
        };
        let name = format!("{wanted}/{number}");
        let info = chip.info().map_err(|error| kernel("look at", &name, &error))?;
        if number >= info.num_lines {
            let (chip, count) = (wanted.to_owned(), info.num_lines);
            return Err(LineError::NoNumber { chip, number, count });
        }
        Ok(LinePosition { chip: chip.path().to_owned(), number, name })
    }

    fn find_name(&self, wanted: &str) -> Result<LinePosition, LineError> {
        let (mut found, mut names) = (Vec::new(), Vec::new());
        let mut problem = None;
        for path in self.files() {
            let chip = match open(&path) {
                Ok(chip) => chip,
                Err(error) => {
                    problem = Some(error);
                    continue;
                }
            };
            for info in chip.line_info_iter().into_iter().flatten().flatten() {
                if info.name == wanted {
                    found.push((chip.path().to_owned(), chip.name(), info.offset));
                } else if !info.name.is_empty() {
                    names.push(info.name);
                }
            }
        }
        match found.as_slice() {
            [(chip, _, number)] => {
                Ok(LinePosition { chip: chip.clone(), number: *number, name: wanted.to_owned() })
            }
            // The line may be on a chip that could not be opened.
            [] => Err(problem.unwrap_or_else(|| LineError::NoName {
                wanted: wanted.to_owned(),
                near: near(wanted, names),
                known: self.known(),
            })),
            several => {
                let line = |(_, chip, number): &_| format!("\"{chip}/{number}\"");
                let lines = several.iter().map(line).collect();
                Err(LineError::Ambiguous { name: wanted.to_owned(), lines })
            }
        }
    }
}

fn open(path: &Path) -> Result<Chip, LineError> {
    Chip::from_path(path).map_err(|error| {
        let source = system(&error);
        match source.kind() {
            io::ErrorKind::PermissionDenied => LineError::NotAllowed { path: path.to_owned() },
            _ => LineError::Kernel { what: "open", line: path.display().to_string(), source },
        }
    })
}

fn label(chip: &Chip) -> Option<String> {
    Some(chip.info().ok()?.label)
}

/// Returns the name in `names` that is most similar to `wanted`; `None` if even that name differs
/// in more than a third of the characters.
fn near(wanted: &str, names: Vec<String>) -> Option<String> {
    let distance =
        |name: &String| strsim::damerau_levenshtein(&name.to_lowercase(), &wanted.to_lowercase());
    let nearest = names.into_iter().min_by_key(distance)?;
    (distance(&nearest) <= wanted.chars().count() / 3).then_some(nearest)
}

/// Returns the system's error inside an error of the crate `gpiocdev`, without the crate's context.
fn system(error: &gpiocdev::Error) -> io::Error {
    use gpiocdev_uapi::Error::Os;
    match error {
        gpiocdev::Error::Os(number) | gpiocdev::Error::Uapi(_, Os(number)) => {
            io::Error::from_raw_os_error(number.0)
        }
        other => io::Error::other(other.to_string()),
    }
}

fn kernel(what: &'static str, line: &str, error: &gpiocdev::Error) -> LineError {
    LineError::Kernel { what, line: line.to_owned(), source: system(error) }
}

// === impl GpioBoard for GpioChips ===

impl LinePosition {
    fn config(&self, is_active_low: bool) -> Config {
        let mut config = Config::default();
        config.on_chip(&self.chip).with_line(self.number);
        if is_active_low {
            config.as_active_low();
        }
        config
    }

    fn request(&self, config: &Config) -> Result<Request, LineError> {
        let mut builder = Request::from_config(config.clone());
        builder.with_consumer(CONSUMER).request().map_err(|error| {
            match kernel("open", &self.name, &error) {
                LineError::Kernel { source, .. }
                    if source.kind() == io::ErrorKind::ResourceBusy =>
                {
                    LineError::Used { line: self.name.clone(), consumer: self.consumer() }
                }
                other => other,
            }
        })
    }

    /// Describes the present user of the line, for the message that the line is in use.
    fn consumer(&self) -> String {
        let info = Chip::from_path(&self.chip).and_then(|chip| chip.line_info(self.number));
        match info {
            Ok(info) if info.consumer == CONSUMER => "another agent of Althing".to_owned(),
            Ok(info) if !info.consumer.is_empty() => format!("`{}`", info.consumer),
            _ => "another program".to_owned(),
        }
    }
}

impl GpioBoard for GpioChips {
    fn input(&self, wanted: &InputSettings) -> Result<Box<dyn InputLine>, LineError> {
        let place = self.find(&wanted.line)?;
        let mut plain = place.config(wanted.is_active_low);
        plain.as_input();
        if let Some(bias) = wanted.bias {
            plain.with_bias(match bias {
                Bias::PullUp => gpiocdev::line::Bias::PullUp,
                Bias::PullDown => gpiocdev::line::Bias::PullDown,
                Bias::None => gpiocdev::line::Bias::Disabled,
            });
        }
        let mut with_edges = plain.clone();
        with_edges.with_edge_detection(EdgeDetection::BothEdges);
        if let Some(debounce) = wanted.debounce {
            with_edges.with_debounce_period(debounce);
        }
        let (request, tells_edges) = match place.request(&with_edges) {
            Ok(request) => (request, true),
            Err(error @ LineError::Used { .. }) => return Err(error),
            // The chip has no interrupts. Any other problem would occur again in the second
            // request.
            Err(error) => {
                let request = place.request(&plain)?;
                tracing::info!(line = place.name, "the line is polled: failed to {error}");
                (request, false)
            }
        };
        let request = polled(request).map_err(|source| {
            let line = place.name.clone();
            LineError::Kernel { what: "wait for", line, source }
        })?;
        Ok(Box::new(WatchedLine { request, reports_edges: tells_edges, name: place.name }))
    }

    fn output(&self, wanted: &OutputSettings) -> Result<Box<dyn OutputLine>, LineError> {
        let place = self.find(&wanted.line)?;
        let mut config = place.config(wanted.is_active_low);
        // The line is first requested in its present state, to read its value; then as an output
        // with that value.
        let request = place.request(config.as_is())?;
        let value = request.lone_value().map_err(|error| kernel("read", &place.name, &error))?;
        let driven = request.reconfigure(config.as_output(value));
        driven.map_err(|error| kernel("drive", &place.name, &error))?;
        Ok(Box::new(DrivenLine { request, name: place.name }))
    }
}

/// Registers the kernel's request for a line with the Tokio runtime, so that edges of the line can
/// be awaited.
#[expect(deprecated, reason = "a request owns its descriptor; what replaces this is `unsafe`")]
fn polled(request: Request) -> io::Result<AsyncFd<Request>> {
    AsyncFd::new(request)
}

struct WatchedLine {
    request: AsyncFd<Request>,
    reports_edges: bool,
    name: String,
}

impl WatchedLine {
    /// Returns the edges that the kernel has kept since the last call. The function
    /// `read_edge_event` of the crate `gpiocdev` is not used, because it drops all edges but one.
    fn kept_edges(&self) -> gpiocdev::Result<Vec<bool>> {
        let request = self.request.get_ref();
        let size = request.edge_event_u64_size();
        let mut buffer = vec![0; size * EDGES_MAX];
        let count = request.read_edge_events_into_slice(&mut buffer)?;
        let events = buffer[..count].chunks_exact(size);
        let is_active = |event: &[u64]| {
            let event = request.edge_event_from_slice(event)?;
            Ok(event.kind == EdgeKind::Rising)
        };
        events.map(is_active).collect()
    }
}

impl InputLine for WatchedLine {
    fn value(&self) -> Result<bool, LineError> {
        read(self.request.get_ref(), &self.name)
    }

    fn edges(&self) -> BoxFuture<'_, Result<Vec<bool>, LineError>> {
        Box::pin(async move {
            let failed = |error: &gpiocdev::Error| kernel("wait for", &self.name, error);
            loop {
                let ready = self.request.readable().await;
                let mut ready = ready.map_err(|error| failed(&error.into()))?;
                // The descriptor of a chip that is gone is readable as well; this call then returns
                // the error.
                if self.request.get_ref().has_edge_event().map_err(|error| failed(&error))? {
                    return self.kept_edges().map_err(|error| failed(&error));
                }
                ready.clear_ready();
            }
        })
    }

    fn reports_edges(&self) -> bool {
        self.reports_edges
    }
}

struct DrivenLine {
    request: Request,
    name: String,
}

impl OutputLine for DrivenLine {
    fn value(&self) -> Result<bool, LineError> {
        read(&self.request, &self.name)
    }

    fn set(&self, is_active: bool) -> Result<(), LineError> {
        let set = self.request.set_lone_value(Value::from(is_active));
        set.map_err(|error| kernel("drive", &self.name, &error))
    }
}

fn read(request: &Request, name: &str) -> Result<bool, LineError> {
    let value = request.lone_value().map_err(|error| kernel("read", name, &error))?;
    Ok(value == Value::Active)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(chips: &GpioChips, line: &str) -> String {
        let line = LineName::try_from(line.to_owned()).expect("a name");
        let wanted = OutputSettings { line, is_active_low: false };
        chips.output(&wanted).err().expect("it is not there").to_string()
    }

    #[test]
    fn an_unknown_chip_is_reported_with_the_known_ones() {
        let known = GpioChips::default().known();
        let there = match known.as_slice() {
            [] => "this machine has none that this user may open".to_owned(),
            known => format!("there are {}", known.join(", ")),
        };
        assert_eq!(
            problem(&GpioChips::default(), "gpiochip999/1"),
            format!("find the GPIO chip `gpiochip999`; {there}")
        );
        let no_name = problem(&GpioChips::default(), "NO-SUCH-LINE-AT-ALL");
        assert!(no_name.starts_with("find a line named `NO-SUCH-LINE-AT-ALL`; "), "{no_name}");
    }

    #[test]
    fn a_file_that_is_not_a_chip_is_ignored() {
        let folder = tempfile::tempdir().expect("a folder");
        let chips = GpioChips::new(folder.path());
        std::fs::write(folder.path().join("gpiochip0"), "").expect("a file");
        std::os::unix::fs::symlink("/dev/null", folder.path().join("gpiochip1")).expect("a link");
        for line in ["gpiochip0/1", "gpiochip1/1", "gpiochip2/1"] {
            let chip = &line[..line.len() - 2];
            let none = "this machine has none that this user may open";
            assert_eq!(problem(&chips, line), format!("find the GPIO chip `{chip}`; {none}"));
        }
    }

    #[test]
    fn a_similar_name_is_suggested() {
        let names = || vec!["GPIO17".to_owned(), "GPIO27".to_owned(), "ID_SDA".to_owned()];
        assert_eq!(near("gpio17", names()).as_deref(), Some("GPIO17"));
        assert_eq!(near("GPIO_27", names()).as_deref(), Some("GPIO27"));
        assert_eq!(near("PIR", names()), None);
        assert_eq!(near("", Vec::new()), None);
    }
}
