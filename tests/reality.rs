//! The paper's first two scenarios with real sensors and plugins that are processes. A robot
//! replaces every sensor that fails.
//!
//! - With the building's truth: a thermometer on a real broker, one in Python, and one that is
//!   installed later.
//! - In a real kernel, Debian's `user-mode-linux`, in which the whole ecosystem runs: the kernel's
//!   own thermometer, read by a plugin process; the broker's; and one in Python, installed later.
//!   The robot measures the simulated building, and no device reports the same number: the known
//!   number of a room shows which device has measured it.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use building::{Building, BuildingDevice, BuildingEvent, Layout, Truth};
use serde_json::json;

use crate::kernel::{SAID, THERMOMETER, said_in};
use crate::support::broker::Broker;
use crate::support::left_out::left_out;
use crate::support::packages::{self, copy, has_python, replace, sensor_process, thermometer};
use crate::support::{Office, PATIENCE, lab, lines};

/// Memory of the kernel, in megabytes.
const MEGABYTES: u32 = 1_024;

/// The broker inside; the kernel has no network to the outside.
const BROKER: &str = "/usr/sbin/mosquitto";

/// The agents and the building.
const CAST: &str = r#"
[goals]
temperatures = "(forall (?r - room) (known-temperature ?r))"

[[agent]]
name = "turtlebot-1"
plugin = "turtlebot"
config = { start = "corridor", speed = 0.3 }

[[agent]]
name = "ir-1"
plugin = "ir-temperature-sensor"
config = { mounted-on = "turtlebot-1", valid-for = "20s" }

[[agent]]
name = "zigbee"
plugin = "mqtt"
config = { broker = "127.0.0.1:1883" }

[[agent]]
name = "thermometer"
package = "sensors"
plugin = "temperature-sensor"
driver = "linux"
config = { location = "office2", device = "DEVICE" }

[building]
temperatures = { office1 = 20.5, office2 = 21.5, conf-room = 22.5 }
time-scale = 0.02
"#;

#[test]
fn sensors_of_a_real_kernel_go_down_and_the_robot_takes_over() {
    if !has_python() || !has_broker() {
        return;
    }
    for mode in ["decentralized", "centralized"] {
        let office = Office::new();
        let file = lab(mode) + &CAST.replace("DEVICE", THERMOMETER);
        let file = office.write("lab.toml", &file);
        sensors(&office.plugins_folder(), "");
        // The caretaker inside moves the package into the folder of plugins.
        copy(&thermometer(), &office.folder().join("later/thermometer"));
        let manifest = office.folder().join("later/thermometer/plugin.toml");
        let config = "{ location = \"office1\", celsius = 19.25 }";
        replace(&manifest, "{ location = \"office2\" }", config);
        office.write("broker.conf", "listener 1883 127.0.0.1\nallow_anonymous true\nuser root\n");
        let Some(said) = said_in(office.folder(), MEGABYTES, &inside(&office, &file)) else {
            return;
        };
        let expected = [
            "the robot, the kernel and the broker: 20.5 25 23.75",
            "office2 goes down, and the robot goes there: 21.5",
            "the conference room goes down too: 22.5",
            "a sensor of Python is put into office1: 19.25",
        ];
        assert_eq!(said, expected, "{mode}: {}", printed(&office));
    }
}

/// Waits until the sensor `sensor` has measured a room since a position in the building's log.
async fn until_read(building: &Building, sensor: &str, room: &str, since: u64) {
    let is_it = |truth: &Truth| {
        let mut since = truth.occurrences().filter(|occurrence| occurrence.sequence >= since);
        since.any(|occurrence| {
            matches!(&occurrence.event, BuildingEvent::Read { sensor: by, location, .. }
                if by == sensor && location == room)
        })
    };
    let waited = tokio::time::timeout(PATIENCE, building.wait_for(is_it)).await;
    assert!(waited.is_ok(), "`{sensor}` has not measured {room}");
}

/// Returns the robot's part of the file, and the socket of the simulated building.
fn robot(layout: &Layout, socket: &Path) -> String {
    let mut text = String::new();
    for device in layout.devices() {
        text += &match device {
            BuildingDevice::Robot { name, start, .. } => format!(
                "[[agent]]\nname = \"{name}\"\nplugin = \"turtlebot\"\n\
                 config = {{ start = \"{start}\" }}\n\n"
            ),
            BuildingDevice::MountedSensor { name, carrier } => format!(
                "[[agent]]\nname = \"{name}\"\nplugin = \"ir-temperature-sensor\"\n\
                 config = {{ mounted-on = \"{carrier}\", valid-for = \"4s\" }}\n\n"
            ),
            _ => String::new(),
        };
    }
    format!("{text}[building]\ntime-scale = 0.02\nsocket = \"{}\"\n", socket.display())
}

#[tokio::test(flavor = "multi_thread")]
async fn failed_sensors_are_replaced_according_to_the_truth() {
    let Some(broker) = Broker::start() else { return };
    if !has_python() {
        return;
    }
    for mode in ["decentralized", "centralized"] {
        let layout = Layout::seeded(0).layout;
        let (heard, python) = ("office2", "conf-room");
        let robots = layout.devices().iter().filter_map(|device| match device {
            BuildingDevice::MountedSensor { name, .. } => Some(name.clone()),
            _ => None,
        });
        let ir = { robots }.next().expect("the paper's robot has one");
        let building = Building::new(layout.clone(), 0.02).expect("a building");
        let mut office = Office::new();
        let socket = office.folder().join("building.sock");
        let _server = building::serve(building.handle(), &socket).await.expect("a socket");
        let celsius = |room| building.truth().temperature(room).expect("a room");

        let gateway = format!(
            "[[agent]]\nname = \"zigbee\"\nplugin = \"mqtt\"\nconfig = {{ broker = \"{}\" }}\n\n",
            broker.name()
        );
        let file = lab(mode) + &gateway + &robot(&layout, &socket);
        let file = office.write("lab.toml", &file);
        office = office.with_file(file).with_python();
        let device = json!([{ "ieee_address": "0x1", "type": "EndDevice",
            "friendly_name": "office2 thermo", "definition": { "exposes": [
            { "type": "numeric", "name": "temperature", "property": "temperature",
              "unit": "°C", "access": 1 } ] } }]);
        broker.retain("zigbee2mqtt/bridge/devices", &device.to_string());
        let said = json!({ "temperature": celsius(heard) });
        broker.retain("zigbee2mqtt/office2 thermo", &said.to_string());
        let online = "zigbee2mqtt/office2 thermo/availability";
        broker.retain(online, "online");
        let package = office.plugins_folder().join("thermometer");
        copy(&thermometer(), &package);
        let config = format!("{{ location = \"{python}\", celsius = {:?} }}", celsius(python));
        replace(&package.join("plugin.toml"), "{ location = \"office2\" }", &config);

        office.up(&["daemon"], &[]);
        office.await_devices(4);
        let goal = "(forall (?r - room) (known-temperature ?r))";
        let mut asking = office.command(&["goal", goal, "--maintain"]);
        let mut asking = asking.stdout(Stdio::piped()).spawn().expect("our own program");
        let told = lines(&mut asking);
        let next = || told.recv_timeout(PATIENCE).expect("it holds in time");
        while !next().contains("the goal holds") {}
        // Scenario 1: the sensor of office2 fails, and the robot goes there instead.
        let truth = building.truth();
        assert!(truth.was_read("office1") && !truth.was_read(heard) && !truth.was_read(python));
        let since = truth.next_sequence();
        broker.retain(online, "offline");
        until_read(&building, &ir, heard, since).await;
        // Scenario 2: the sensor of the conference room fails too.
        let since = building.truth().next_sequence();
        assert_eq!(office.ask(&["plugin", "disable", "thermometer"]).0, Some(0));
        until_read(&building, &ir, python, since).await;
        // A new sensor is installed, and the robot is no longer needed for the room.
        let new =
            BuildingDevice::FixedSensor { name: "new-1".to_owned(), location: heard.to_owned() };
        building.add_device(new).expect("a new name");
        sensors(
            &office.plugins_folder(),
            "\n[[agent]]\nname = \"new-1\"\nconfig = { location = \"office2\" }\n",
        );
        until_read(&building, "new-1", heard, since).await;
        asking.kill().expect("our own child");
        asking.wait().expect("our own child");
    }
}

fn has_broker() -> bool {
    if Path::new(BROKER).exists() {
        return true;
    }
    left_out("mosquitto is missing: apt-get install mosquitto mosquitto-clients");
    false
}

/// Makes a package of the plugin `sensor`, which may read the kernel's devices.
fn sensors(folder: &Path, agents: &str) {
    let package = folder.join(".sensors");
    fs::create_dir_all(&package).expect("a folder");
    std::fs::copy(sensor_process(), package.join("sensor-process")).expect("a program");
    let machine = format!("{}-linux", std::env::consts::ARCH);
    let text = format!(
        "name = \"sensors\"\nversion = \"1\"\nprotocol = \"2\"\n\n\
         [executable]\n{machine} = \"sensor-process\"\n\n[action.report-temperature]\n\
         method = \"read_temperature\"\ntimeout = \"2s\"\n\n\
         [config.location]\ntype = \"text\"\n\n[config.device]\ntype = \"text\"\noptional = true\n\n\
         [permissions]\nread = [\"/sys\"]\n{agents}"
    );
    fs::write(package.join("plugin.toml"), text).expect("a file");
    // As `althing plugin allow sensors` writes it.
    fs::write(folder.join(".sensors.rights"), "read=/sys\n").expect("a file");
    fs::rename(&package, folder.join("sensors")).expect("the same file system");
}

/// Returns what the kernel has printed, to diagnose a failure.
fn printed(office: &Office) -> String {
    let printed = fs::read(office.folder().join("out")).unwrap_or_default();
    String::from_utf8_lossy(&printed).into_owned()
}

/// Returns the script that the kernel runs as its first process.
fn inside(office: &Office, file: &Path) -> String {
    let (althing, file) = (env!("CARGO_BIN_EXE_althing"), file.display());
    let path = packages::path().into_string().expect("a path in UTF-8");
    let (folder, plugins) = (office.folder().display(), office.plugins_folder());
    format!(
        r#"export PATH={path}:$PATH
export ALTHING_PDDL=1 ALTHING_RUNTIME_DIR=/run/althing ALTHING_STATE_DIR=/run/state ALTHING_PLUGINS_DIR=/run/plugins
said() {{ echo "{SAID}$*"; }}
ask() {{ {althing} "$@" --ecosystem {file}; }}
# What a room is known by.
of() {{ ask state | sed -n "s/^ *(= (temperature $1) \([0-9.]*\)).*/\1/p"; }}
until_of() {{ until [ "$(of $1)" = "$2" ]; do sleep 0.1; done; }}
tell() {{ mosquitto_pub -h 127.0.0.1 -r -t "zigbee2mqtt/$1" -m "$2"; }}

cp -r {plugins} /run/plugins
mosquitto -c {folder}/broker.conf > /run/broker 2>&1 &
until tell 'conf-room thermo' '{{"temperature":23.75}}'; do sleep 0.1; done
tell bridge/devices '[{{"ieee_address":"0x1","type":"EndDevice","friendly_name":"conf-room thermo",
    "definition":{{"exposes":[{{"type":"numeric","name":"temperature","property":"temperature",
    "unit":"°C","access":1}}]}}}}]'
{althing} up {file} > /run/up 2>&1 &
# Shown where the test fails.
(sleep 150; cat /run/up /run/goal; ask state; ask plugin list) 2>&1 &
until ask agents | grep -c report-temperature | grep -q 3; do sleep 0.1; done

# Scenario 1.
ask goal temperatures --maintain > /run/goal 2>&1 &
until_of office1 20.5; until_of office2 25; until_of conf-room 23.75
said "the robot, the kernel and the broker: $(of office1) $(of office2) $(of conf-room)"
echo 0x40 > delete_device
until_of office2 21.5
said "office2 goes down, and the robot goes there: $(of office2)"

# Scenario 2.
tell 'conf-room thermo/availability' '{{"state":"offline"}}'
until_of conf-room 22.5
said "the conference room goes down too: $(of conf-room)"
cp -r {folder}/later/thermometer /run/thermometer
mv /run/thermometer /run/plugins/
until_of office1 19.25
said "a sensor of Python is put into office1: $(of office1)"
"#,
        plugins = plugins.display()
    )
}
