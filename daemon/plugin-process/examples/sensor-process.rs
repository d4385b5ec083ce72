//! The plugin `sensor`, unchanged, as a program of its own: what a package of it runs.

fn main() -> std::process::ExitCode {
    plugin_process::run(&[sensor::TEMPERATURE_SENSOR, sensor::PLUGIN])
}
