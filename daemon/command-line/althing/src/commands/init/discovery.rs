//! Looks for devices near this machine, all at once and within three seconds: sensors of the
//! kernel, an MQTT broker, cameras, ROS 2 robots behind a router of this machine, ecosystems that
//! run here.

use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use ecosystem_edit::{AgentAddition, DeviceOffer, SettingText, as_name};
use linux_sensors::{SensorBundle, SensorChannel, Sysfs, SysfsQuantity};

use crate::commands::{client, sensors};

/// How long all searches together may take; they run side by side, and a person waits.
pub(super) const FOUND_WITHIN: Duration = Duration::from_secs(3);

/// How long cameras may take to answer. They answer within half a second, and are asked twice.
const CAMERAS_ANSWER_WITHIN: Duration = Duration::from_secs(2);

/// How long a program on this machine may take to accept a connection.
const ACCEPTED_WITHIN: Duration = Duration::from_millis(500);

/// Ports of MQTT brokers without TLS, and of Zenoh routers.
const MQTT_PORT: u16 = 1883;
const ZENOH_PORT: u16 = 7447;

/// Maximum number of devices that are offered; a person is asked about each.
const OFFERS_MAX: usize = 32;

/// The devices that were found, and what else a person should know.
#[derive(Default)]
pub(super) struct Discovery {
    pub(super) offers: Vec<DeviceOffer>,
    pub(super) notes: Vec<String>,
}

/// One search; its name completes “the search for …”.
struct DeviceSearch {
    name: &'static str,
    run: Box<dyn FnOnce() -> Discovery + Send>,
}

/// Runs all searches. Those that are not done in time are named in a note.
pub(super) fn discover(sysfs: &Path) -> Discovery {
    let sysfs = sysfs.to_owned();
    let searches = vec![
        search("sensors of this machine", move || kernel_sensors(&sysfs)),
        search("an MQTT broker", broker),
        search("cameras of this machine", || video_devices(Path::new("/dev"))),
        search("cameras in the network", network_cameras),
        search("ROS 2 robots", robots),
        search("running ecosystems", ecosystems),
    ];
    run(searches, FOUND_WITHIN)
}

fn search(name: &'static str, run: impl FnOnce() -> Discovery + Send + 'static) -> DeviceSearch {
    DeviceSearch { name, run: Box::new(run) }
}

/// Runs searches side by side, for at most the time `within`.
fn run(searches: Vec<DeviceSearch>, within: Duration) -> Discovery {
    let deadline = Instant::now() + within;
    let names: Vec<_> = searches.iter().map(|search| search.name).collect();
    let (tell, found) = mpsc::channel();
    for (index, search) in searches.into_iter().enumerate() {
        let tell = tell.clone();
        // A search that hangs ends with this process.
        std::thread::spawn(move || {
            let _ = tell.send((index, (search.run)()));
        });
    }
    drop(tell);
    let mut results: Vec<Option<Discovery>> = names.iter().map(|_| None).collect();
    while results.iter().any(Option::is_none) {
        let left = deadline.saturating_duration_since(Instant::now());
        let Ok((index, result)) = found.recv_timeout(left) else { break };
        if let Some(place) = results.get_mut(index) {
            *place = Some(result);
        }
    }
    let mut all = Discovery::default();
    for (name, result) in names.into_iter().zip(results) {
        match result {
            Some(Discovery { offers, notes }) => {
                all.offers.extend(offers);
                all.notes.extend(notes);
            }
            None => all.notes.push(format!("the search for {name} took too long")),
        }
    }
    all.offers.truncate(OFFERS_MAX);
    all
}

fn kernel_sensors(sysfs: &Path) -> Discovery {
    let channels = Sysfs::new(sysfs).channels();
    let bundles = SensorBundle::all(&channels).into_iter().zip(1_u32..);
    let offers = bundles.map(|(bundle, number)| sensor_offer(&bundle, number, &channels)).collect();
    Discovery { offers, notes: Vec::new() }
}

fn sensor_offer(bundle: &SensorBundle, number: u32, channels: &[SensorChannel]) -> DeviceOffer {
    let SensorBundle { device, quantity, channel, has_humidity } = bundle;
    let is_it = |it: &&SensorChannel| it.device == *device && it.quantity == *quantity;
    let value = channels.iter().find(is_it).and_then(|channel| channel.read().ok());
    let now = value.map(|value| format!(", now {value:.1} {}", quantity.unit()));
    let is_thermometer = *quantity == SysfsQuantity::Temperature;
    let mut config = vec![SettingText::text("device", &device.to_string())];
    config.extend(channel.iter().map(|channel| SettingText::text("channel", channel)));
    if !is_thermometer {
        config.push(SettingText::text("quantity", quantity.name()));
    } else if *has_humidity {
        config.push(SettingText::flag("humidity"));
    }
    let plugin = if is_thermometer { "temperature-sensor" } else { "sensor" };
    DeviceOffer {
        about: format!("{device} ({quantity}{})", now.unwrap_or_default()),
        agent: Some(AgentAddition {
            plugin: plugin.to_owned(),
            driver: Some("linux".to_owned()),
            config,
            ..AgentAddition::default()
        }),
        quantity: quantity.name().to_owned(),
        lines: sensors::entry(bundle, number),
    }
}

/// Whether a program on this machine accepts connections at a port.
fn is_listening(port: u16) -> bool {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    TcpStream::connect_timeout(&address, ACCEPTED_WITHIN).is_ok()
}

fn broker() -> Discovery {
    let mut found = Discovery::default();
    if is_listening(MQTT_PORT) {
        found.offers.push(DeviceOffer {
            about: format!(
                "something listens at localhost:{MQTT_PORT}, the port of MQTT brokers: this brings \
                 its devices (docs/devices.md)"
            ),
            lines: format!(
                "[[agent]]\nname = \"mqtt\"\nplugin = \"mqtt\"\n\n[agent.config]\n\
                 broker = \"localhost:{MQTT_PORT}\"\n"
            ),
            ..DeviceOffer::default()
        });
    }
    found
}

/// Finds cameras that are plugged into this machine: by their names, or else by their numbers.
fn video_devices(devices: &Path) -> Discovery {
    let names = |folder: PathBuf| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut paths: Vec<_> = entries.map(|entry| entry.path()).collect();
        paths.sort();
        paths
    };
    let name_of = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    // A camera has several devices; the first one has its pictures.
    let named = names(devices.join("v4l/by-id")).into_iter();
    let mut cameras: Vec<_> =
        named.filter(|path| name_of(path).ends_with("-video-index0")).collect();
    if cameras.is_empty() {
        let numbered = names(devices.to_owned()).into_iter();
        cameras = numbered.filter(|path| name_of(path) == "video0").collect();
    }
    let offer = |(path, number): (&PathBuf, u32)| DeviceOffer {
        about: format!("the camera {} (docs/cameras.md)", path.display()),
        lines: format!(
            "[[agent]]\nname = \"camera-{number}\"\nplugin = \"ptz-camera\"\ndriver = \"v4l2\"\n\n\
             [agent.config]\nlocation = \"\"        # the room that it shows\ndevice = \"{}\"\n",
            toml_text(&path.display().to_string())
        ),
        ..DeviceOffer::default()
    };
    Discovery { offers: cameras.iter().zip(1..).map(offer).collect(), notes: Vec::new() }
}

fn network_cameras() -> Discovery {
    let mut found = Discovery::default();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let Ok(runtime) = runtime else { return found };
    let asked = onvif_link::discover(onvif_link::WS_DISCOVERY, CAMERAS_ANSWER_WITHIN);
    // No network, or none with multicast: then there is no camera to offer.
    for camera in runtime.block_on(asked).unwrap_or_default() {
        let called = [&camera.name, &camera.hardware].into_iter().find(|name| !name.is_empty());
        let name = called.and_then(|name| as_name(name)).unwrap_or_else(|| "camera".to_owned());
        found.offers.push(DeviceOffer {
            about: format!("the camera at {} (docs/cameras.md)", toml_text(&camera.address)),
            lines: format!(
                "[[agent]]\nname = \"{name}\"\nplugin = \"ptz-camera\"\ndriver = \"onvif\"\n\n\
                 [agent.config]\nlocation = \"\"        # where it hangs\naddress = \"{}\"\n\
                 user = \"althing\"\npassword-file = \"\"   # a file of mode 600 with its password\n",
                toml_text(&camera.address)
            ),
            ..DeviceOffer::default()
        });
    }
    found
}

fn robots() -> Discovery {
    let mut found = Discovery::default();
    if is_listening(ZENOH_PORT) {
        found.notes.push(format!(
            "a Zenoh router listens at localhost:{ZENOH_PORT}: docs/robots.md says how a ROS 2 robot \
             behind it becomes an agent"
        ));
    }
    found
}

fn ecosystems() -> Discovery {
    let note = |name| {
        format!("the ecosystem `{name}` runs on this machine: `althing add` adds to it, too")
    };
    let notes = client::running_here().iter().map(note).collect();
    Discovery { offers: Vec::new(), notes }
}

/// Returns a text from outside without what would end a string or a comment of TOML.
fn toml_text(text: &str) -> String {
    text.chars().filter(|letter| !letter.is_control() && !"\"\\".contains(*letter)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Long enough for a search that finds something at once, on a busy machine.
    const SHORT: Duration = Duration::from_millis(500);

    #[test]
    fn cameras_of_the_machine_are_offered_by_their_names() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("video0"), "").expect("a file");
        let about =
            |found: Discovery| found.offers.into_iter().map(|it| it.about).collect::<Vec<_>>();
        assert_eq!(about(video_devices(folder.path())).len(), 1);
        let named = folder.path().join("v4l/by-id");
        std::fs::create_dir_all(&named).expect("a folder");
        for name in ["usb-X-video-index0", "usb-X-video-index1"] {
            std::fs::write(named.join(name), "").expect("a file");
        }
        let found = about(video_devices(folder.path()));
        assert!(found.len() == 1 && found[0].contains("usb-X-video-index0"), "{found:?}");
    }

    #[test]
    fn a_search_that_takes_too_long_is_named() {
        let (hold, held) = mpsc::channel::<()>();
        let note = || Discovery { notes: vec!["found".to_owned()], ..Discovery::default() };
        let slow = move || {
            let _ = held.recv();
            Discovery::default()
        };
        let searches = vec![search("slow things", slow), search("quick things", note)];
        let found = run(searches, SHORT);
        assert_eq!(found.notes, ["the search for slow things took too long", "found"]);
        drop(hold);
    }
}
