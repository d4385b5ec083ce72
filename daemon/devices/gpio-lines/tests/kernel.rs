//! Tests of the lines of a real chip under a real kernel: the lines are found, watched, driven,
//! unplugged and plugged in.

mod machine;

use std::fs;
use std::sync::Arc;
use std::time::Duration;

use gpio_lines::{
    DrivenOutput, GpioBoard as _, GpioChips, InputSettings, LineName, LineState, LineWatch,
    OutputSettings, watch_line,
};
use machine::{PRESS, SAID, said_by};
use rustix::mount::{MountFlags, mount};
use rustix::system::{RebootCommand, reboot};

/// Name of a line by its chip's number; [`LABELED`] names the same line by its chip's label.
const NUMBERED: &str = "gpiochip0/5";
const LABELED: &str = "9030000.pl061/5";

/// Name of the line that the power button is connected to.
const BUTTON: &str = "9030000.pl061/3";

const PATIENCE: Duration = Duration::from_secs(20);

#[test]
fn a_real_kernels_lines_are_watched_driven_unplugged_and_plugged_in() {
    let Some(said) = said_by("inside") else { return };
    let expected = [
        "failed to find the GPIO chip `gpiochip9`; there are gpiochip0 (9030000.pl061)",
        "failed to find line 99 of `gpiochip0`: it has lines 0 to 7",
        "failed to find a line named `GPIO17`; looked on all chips: \
         there are gpiochip0 (9030000.pl061)",
        "relay Ok(false)",
        "relay Ok(true)",
        "failed to use the line `gpiochip0/5`: another agent of Althing uses it already",
        "as it was left Ok(true)",
        "seen from the other side Ok(false)",
        PRESS,
        "kept for a late reader Ok([true, false])",
        "button false",
        PRESS,
        "button true",
        "button false",
        "relay Err",
        "button unavailable",
        "button false",
        "relay Ok(false)",
    ];
    assert_eq!(said, expected);
}

fn say(what: impl std::fmt::Display) {
    println!("{SAID}{what}");
}

fn line(name: &str) -> LineName {
    name.to_owned().try_into().expect("a name")
}

fn relay(name: &str, is_active_low: bool) -> DrivenOutput {
    let output = OutputSettings { line: line(name), is_active_low };
    DrivenOutput::new(Arc::new(GpioChips::default()), output)
}

/// Part of the test that runs inside the virtual machine, as its only process.
#[test]
#[ignore = "for the machine that the other test begins"]
fn inside() {
    assert_eq!(std::process::id(), 1, "it powers its machine off");
    for (kind, folder) in [("devtmpfs", "/dev"), ("sysfs", "/sys")] {
        let _ = fs::create_dir(folder);
        mount(kind, folder, kind, MountFlags::empty(), None).expect("a kernel has it");
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.expect("a runtime").block_on(use_lines());
    reboot(RebootCommand::PowerOff).expect("we are the first process");
}

async fn use_lines() {
    for name in ["gpiochip9/1", "gpiochip0/99", "GPIO17"] {
        let wanted = OutputSettings { line: line(name), is_active_low: false };
        say(format!(
            "failed to {}",
            GpioChips::default().output(&wanted).err().expect("not there")
        ));
    }
    drive().await;
    let debounce = Some(Duration::from_millis(5));
    let input = InputSettings { line: line(BUTTON), is_active_low: false, bias: None, debounce };
    come_late(&input).await;
    let button = watch_line(Arc::new(GpioChips::default()), input);
    let mut state = button.state();
    let mut next = async || {
        let changed = tokio::time::timeout(PATIENCE, state.changed()).await;
        changed.expect("in time").expect("it is followed");
        match &*state.borrow_and_update() {
            LineState::Unknown => say("button unknown"),
            LineState::Present(is_active) => say(format!("button {is_active}")),
            LineState::Unavailable(_) => say("button unavailable"),
        }
    };
    next().await;
    say(PRESS);
    next().await;
    next().await;
    unplug(&button, next).await;
}

async fn drive() {
    let first = relay(NUMBERED, false);
    say(format!("relay {:?}", first.value().await));
    say(format!("relay {:?}", first.set(true).await));
    say(format!("failed to {}", relay(NUMBERED, false).value().await.expect_err("it is used")));
    drop(first);
    say(format!("as it was left {:?}", relay(NUMBERED, false).value().await));
    say(format!("seen from the other side {:?}", relay(NUMBERED, true).value().await));
}

/// Opens the button's line, but waits for its edges only after the button was released.
async fn come_late(input: &InputSettings) {
    let button = GpioChips::default().input(input).expect("it is there");
    say(PRESS);
    tokio::time::sleep(Duration::from_secs(1)).await;
    let edges = tokio::time::timeout(PATIENCE, button.edges()).await;
    say(format!("kept for a late reader {:?}", edges.expect("in time")));
}

/// Unbinds the driver of the button's chip, and binds it again.
async fn unplug(button: &LineWatch, mut next: impl AsyncFnMut()) {
    // Afterwards the chip may have another number, but it has the same label.
    let relay = relay(LABELED, false);
    relay.set(false).await.expect("it is there");
    let driver = |what: &str| format!("/sys/bus/amba/drivers/pl061_gpio/{what}");
    fs::write(driver("unbind"), "9030000.pl061").expect("it is bound");
    say(if relay.value().await.is_err() { "relay Err" } else { "relay is still there" });
    next().await;
    fs::write(driver("bind"), "9030000.pl061").expect("it is not bound");
    next().await;
    say(format!("relay {:?}", relay.value().await));
    assert!(matches!(*button.state().borrow(), LineState::Present(false)));
}
