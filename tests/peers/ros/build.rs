//! Generates the messages of Nav2 and of the Create 3 with the generator of `hiroz`, from the
//! definitions that ROS publishes.

use std::path::{Path, PathBuf};

use hiroz_codegen::{GeneratorConfig, MessageGenerator, discover_bundled_packages};

const PACKAGES: [&str; 2] = ["nav2_msgs", "irobot_create_msgs"];

fn main() -> anyhow::Result<()> {
    let definitions = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../daemon/devices/ros-messages/definitions");
    println!("cargo:rerun-if-changed={}", definitions.display());
    let config = GeneratorConfig {
        generate_cdr: true,
        generate_protobuf: false,
        generate_type_info: true,
        is_humble: false,
        output_dir: PathBuf::from(std::env::var("OUT_DIR")?),
        external_crate: Some("hiroz_msgs".to_owned()),
        local_packages: PACKAGES.map(str::to_owned).into(),
        json_out: None,
    };
    let packages = PACKAGES.map(|name| definitions.join(name));
    let bundled = discover_bundled_packages(false)?;
    MessageGenerator::new(config).generate_from_msg_files_with_deps(
        &packages.each_ref().map(PathBuf::as_path),
        &bundled.iter().map(PathBuf::as_path).collect::<Vec<_>>(),
    )
}
