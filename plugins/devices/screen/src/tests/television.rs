//! The driver `cec` with a made-up `cec-ctl`, which prints what the real one prints (see
//! `cec_output.rs`) about a television that is a folder: files say whether it is on, what it shows,
//! and whether it answers. The last test is for a real kernel: `.ci/television` runs it.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::json;
use tempfile::TempDir;

use super::*;
use crate::cec::CecSettings;
use crate::player::{Player, PlayerTrouble};

/// A program that understands the arguments that the driver uses.
const CEC_CTL: &str = r#"#!/bin/sh
cd "$(dirname "$0")" || exit 1
[ -e broken ] && { echo "Failed to open $2: No such file or directory" >&2; exit 1; }
while [ $# -gt 0 ]; do
    case $1 in
        --playback) printf '\tPhysical Address           : %s\n' "$(cat place)" ;;
        --image-view-on) [ -e stubborn ] || echo on > power ;;
        --active-source) echo "${2#phys-addr=}" > shown ;;
        --standby) echo standby > power ;;
        --give-device-power-status)
            if [ -e deaf ]; then printf '\tTx, Not Acknowledged (4), Max Retries\n'
            else printf '\tpwr-state: %s (0x00)\n' "$(cat power)"; fi ;;
        --wait-for-msgs)
            sleep 0.3
            printf 'Initial Event: State Change: PA: %s, LA mask: 0x0010\n' "$(cat place)"
            [ -e other ] && printf 'Received from TV to all (0 to 15): ACTIVE_SOURCE (0x82):\n'
            [ -e other ] && printf '\tphys-addr: %s\n' "$(cat other)" ;;
    esac
    shift
done
exit 0
"#;

struct Television(TempDir);

impl Television {
    /// Returns a television in standby, with this machine at its first input.
    fn new() -> Television {
        let television = Television(tempfile::tempdir().expect("a folder"));
        television.set("cec-ctl", CEC_CTL);
        let program = television.0.path().join("cec-ctl");
        fs::set_permissions(program, fs::Permissions::from_mode(0o755)).expect("our own file");
        television.set("place", "1.0.0.0\n");
        television.set("power", "standby\n");
        television
    }

    fn set(&self, name: &str, text: &str) {
        // A file that is read meanwhile is never half of what is written.
        let next = self.0.path().join(format!("{name}.next"));
        fs::write(&next, text).expect("a file");
        fs::rename(next, self.0.path().join(name)).expect("a file");
    }

    fn unset(&self, name: &str) {
        fs::remove_file(self.0.path().join(name)).expect("it was set");
    }

    fn get(&self, name: &str) -> String {
        let text = fs::read_to_string(self.0.path().join(name)).unwrap_or_default();
        text.trim().to_owned()
    }

    fn screen(&self) -> Screen {
        let program = self.0.path().join("cec-ctl").display().to_string();
        let media = json!({ "computer": "this machine" });
        let config = json!({ "location": "lab", "media": media, "program": program });
        screen(&blueprint("cec", config, Resources::default())).expect("a screen")
    }
}

#[tokio::test]
async fn a_television_is_turned_on_shows_this_machine_and_is_turned_off() {
    let television = Television::new();
    let mut screen = television.screen();
    set_up(&mut screen).await;
    assert_eq!(television.get("power"), "standby", "it is left as it is");
    assert_eq!(call(&mut screen, "show", Some("computer")).await.as_deref(), Ok("shows it"));
    assert_eq!((television.get("power"), television.get("shown")), ("on".into(), "1.0.0.0".into()));
    assert!(text_of(&screen).contains("(presented computer lab)"));
    assert_eq!(call(&mut screen, "hide", None).await.as_deref(), Ok("is dark"));
    assert_eq!(television.get("power"), "standby");
}

#[tokio::test]
async fn a_television_that_people_use_otherwise_is_noticed_and_left_alone() {
    let television = Television::new();
    let mut screen = television.screen();
    set_up(&mut screen).await;
    for place in ["2.0.0.0", "0.0.0.0"] {
        call(&mut screen, "show", Some("computer")).await.expect("shown");
        television.set("other", place);
        until(&mut screen, "!presented computer").await;
        assert_eq!(television.get("power"), "on", "people watch {place}");
        television.unset("other");
    }
    call(&mut screen, "show", Some("computer")).await.expect("shown");
    television.set("power", "standby\n");
    until(&mut screen, "!presented computer").await;
    assert!(text_of(&screen).contains("offers present"));
}

#[tokio::test]
async fn a_television_that_is_gone_or_never_was_there_offers_nothing() {
    let television = Television::new();
    let mut screen = television.screen();
    set_up(&mut screen).await;
    call(&mut screen, "show", Some("computer")).await.expect("shown");
    television.set("deaf", "");
    until(&mut screen, "!offers present").await;
    television.unset("deaf");
    until(&mut screen, "offers present").await;
    television.set("place", "f.f.f.f\n");
    until(&mut screen, "!offers present").await;
    let failure = call(&mut screen, "show", Some("computer")).await.expect_err("unplugged");
    assert!(failure.contains("/dev/cec0"), "{failure}");
    television.set("place", "1.0.0.0\n");
    television.set("broken", "");
    let mut other = television.screen();
    let failure = call(&mut other, "show", Some("computer")).await.expect_err("no device");
    assert!(failure.contains("Failed to open /dev/cec0: No such file"), "{failure}");
}

#[tokio::test]
async fn a_television_that_does_not_turn_on_has_a_reason() {
    let television = Television::new();
    television.set("stubborn", "");
    let mut screen = television.screen();
    set_up(&mut screen).await;
    let failure = call(&mut screen, "show", Some("computer")).await.expect_err("it stays off");
    assert!(failure.contains("turn the television on: it is not on after 20s"), "{failure}");
    until(&mut screen, "offers present").await;
}

/// A program that shows every medium, and can be made to lose it.
struct Made;

static IS_LOST: AtomicBool = AtomicBool::new(false);

impl Player for Made {
    type Settings = ();

    async fn start(_: &()) -> Result<Made, String> {
        Ok(Made)
    }

    async fn show(&mut self, _: Option<&Content>) -> Result<(), PlayerTrouble> {
        Ok(())
    }

    async fn check(&mut self) -> Result<(), PlayerTrouble> {
        match IS_LOST.load(Ordering::SeqCst) {
            true => Err(PlayerTrouble::Content("show it: it is over".to_owned())),
            false => Ok(()),
        }
    }

    async fn failed(&mut self) -> String {
        std::future::pending().await
    }

    async fn end(self) {}
}

#[tokio::test]
async fn a_program_on_a_television_is_shown_only_if_both_show_it() {
    let television = Television::new();
    let program = television.0.path().join("cec-ctl").display().to_string();
    let settings = CecSettings { device: "/dev/cec0".to_owned(), program: Some(program) };
    let display = supervisor::display::<WithTelevision<Made>>("s", ((), Some(settings)));
    let shows = async |wanted: Option<&str>| {
        let looking = async {
            let wanted = wanted.map(str::to_owned);
            while display.panel().await.map_or(true, |panel| panel.shown != wanted) {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(20), looking).await.expect("in time");
    };
    let slides = Content::Text("slides".to_owned());
    display.show(Some(&slides)).await.expect("shown");
    assert_eq!(television.get("power"), "on");
    shows(Some("slides")).await;
    television.set("power", "standby\n");
    shows(None).await;
    display.show(Some(&slides)).await.expect("shown");
    IS_LOST.store(true, Ordering::SeqCst);
    shows(None).await;
    assert_eq!(television.get("power"), "standby", "nothing is shown on it");
}

/// Part of `.ci/television` that runs inside a virtual machine, whose kernel has the driver `vivid`,
/// and whose television is Debian's `cec-follower`. `ALTHING_CEC_DEVICE` is the device of the
/// output, and `ALTHING_CEC_TELEVISION` that of the television, which is told what a person does
/// with a remote control.
#[tokio::test]
#[ignore = "for the kernel that `.ci/television` starts"]
async fn a_real_kernel_carries_the_messages_to_a_television() {
    let [device, television] = ["ALTHING_CEC_DEVICE", "ALTHING_CEC_TELEVISION"]
        .map(|name| std::env::var(name).expect("it is set"));
    let media = json!({ "computer": "this machine" });
    let config = json!({ "location": "lab", "media": media, "television": device });
    let mut screen = screen(&blueprint("cec", config, Resources::default())).expect("a screen");
    set_up(&mut screen).await;
    call(&mut screen, "show", Some("computer")).await.expect("shown");
    println!("@said shown");
    let tell = |arguments: &[&str]| {
        let mut program = std::process::Command::new("cec-ctl");
        program.args(["-s", "-d", &television]).args(arguments);
        assert!(program.status().expect("it runs").success());
    };
    tell(&["--active-source", "phys-addr=0.0.0.0"]);
    until(&mut screen, "!presented computer").await;
    println!("@said its own program is noticed");
    call(&mut screen, "show", Some("computer")).await.expect("shown again");
    tell(&["--set-stream-path", "phys-addr=2.0.0.0"]);
    until(&mut screen, "!presented computer").await;
    println!("@said another input is noticed");
    call(&mut screen, "show", Some("computer")).await.expect("shown again");
    assert_eq!(call(&mut screen, "hide", None).await.as_deref(), Ok("is dark"));
    call(&mut screen, "show", Some("computer")).await.expect("turned on again");
    println!("@said turned off and on");
    tell(&["--clear"]);
    until(&mut screen, "!offers present").await;
    println!("@said unplugged");
}
