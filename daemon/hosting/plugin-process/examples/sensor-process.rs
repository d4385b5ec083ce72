//! The unchanged plugin `sensor` as a program of its own, to be run by a package.

fn main() -> std::process::ExitCode {
    plugin_process::run(&[sensor::TEMPERATURE_SENSOR, sensor::PLUGIN])
}
