//! Plugin packages on a real daemon: installed, planned with, killed, upgraded, removed; and
//! packages that misbehave.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::packages::{copy, has_python, replace, sensor_process, thermometer};
use crate::support::{Office, lab};

const PATIENCE: Duration = Duration::from_secs(60);

/// Installs the Python thermometer under another name, with changes.
fn put(office: &Office, name: &str, change: &dyn Fn(&Path)) {
    let made = office.folder().join("made").join(name);
    copy(&thermometer(), &made);
    replace(&made.join("plugin.toml"), "name = \"thermometer\"", &format!("name = \"{name}\""));
    replace(&made.join("plugin.toml"), "\"py-1\"", &format!("\"agent-of-{name}\""));
    change(&made);
    fs::rename(&made, office.plugins_folder().join(name)).expect("the same file system");
}

/// Starts a daemon of the lab that hosts every package in its folder of plugins.
fn office(mode: &str, more: &str) -> Office {
    let office = Office::new();
    let file = office.write("lab.toml", &(lab(mode) + more));
    let mut office = office.with_file(file).with_python();
    office.up(&["daemon"], &[]);
    office
}

fn status(office: &Office, name: &str) -> Value {
    let listed = office.ask_json(&["plugin", "list"]);
    let plugins = listed["daemons"][0]["plugins"].as_array().cloned().unwrap_or_default();
    plugins.into_iter().find(|plugin| plugin["name"] == name).unwrap_or(Value::Null)
}

/// Waits until the status of a plugin satisfies `is_so`; returns it.
fn await_status(office: &Office, name: &str, is_so: impl Fn(&Value) -> bool) -> Value {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let status = status(office, name);
        if is_so(&status) {
            return status;
        }
        assert!(Instant::now() < deadline, "{name} is not so: {status}");
    }
}

fn await_state(office: &Office, name: &str, state: &str) -> Value {
    await_status(office, name, |status| status["state"] == state)
}

/// Returns the processes with this text in their command line or environment, by number.
fn processes_with(marker: &str) -> Vec<String> {
    let entries = fs::read_dir("/proc").expect("Linux").flatten();
    let of_it = |pid: &String| {
        let read = |file: &str| fs::read(format!("/proc/{pid}/{file}")).unwrap_or_default();
        let said = [read("cmdline"), read("environ")].concat();
        String::from_utf8_lossy(&said).contains(marker)
    };
    let pids = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let pids = pids.filter(|pid| pid.bytes().all(|byte| byte.is_ascii_digit()));
    pids.filter(|pid| *pid != std::process::id().to_string()).filter(of_it).collect()
}

/// Waits until no process of this office's plugins is left.
fn await_none_left(office: &Office) {
    // The plugins' home folder is in the environment of all processes that they start.
    let marker = office.folder().join("state/lab/daemon/plugins").display().to_string();
    let deadline = Instant::now() + PATIENCE;
    while !processes_with(&marker).is_empty() {
        assert!(Instant::now() < deadline, "{:?} are left", processes_with(&marker));
        std::thread::yield_now();
    }
}

fn pid(status: &Value) -> String {
    status["pid"].as_i64().unwrap_or_else(|| panic!("it runs: {status}")).to_string()
}

fn send(signal: &str, pid: &str) {
    let sent = Command::new("kill").args([signal, pid]).status().expect("it is everywhere");
    assert!(sent.success());
}

#[test]
fn an_installed_package_joins_and_a_removed_one_leaves() {
    if !has_python() {
        return;
    }
    for mode in ["decentralized", "centralized"] {
        let office = office(mode, "");
        let goal = ["goal", "(known-temperature office2)"];
        let (code, said) = office.ask(&goal);
        assert_eq!(code, Some(1), "{mode}: nobody measures yet: {said}");

        copy(&thermometer(), &office.plugins_folder().join("thermometer"));
        let status = await_state(&office, "thermometer", "running");
        assert_eq!(status["agents"][0], "py-1", "{status}");
        office.await_devices(1);
        let (code, said) = office.ask(&goal);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert!(said.contains("22.5 °C at office2"), "{mode}: {said}");
        let state = office.ask_json(&["state"]).to_string();
        assert!(state.contains("(= (temperature office2) 22.5)"), "{mode}: {state}");

        let (code, said) = office.ask(&["plugin", "disable", "thermometer"]);
        assert_eq!(code, Some(0), "{said}");
        await_state(&office, "thermometer", "disabled");
        office.await_devices(0);
        await_none_left(&office);
        let (code, said) = office.ask(&["plugin", "enable", "thermometer"]);
        assert_eq!(code, Some(0), "{said}");
        await_state(&office, "thermometer", "running");
        fs::remove_dir_all(office.plugins_folder().join("thermometer")).expect("our own");
        office.await_devices(0);
        await_status(&office, "thermometer", Value::is_null);
        await_none_left(&office);
    }
}

#[test]
fn a_killed_plugin_is_restarted_and_none_outlives_the_daemon() {
    if !has_python() {
        return;
    }
    let mut office = office("decentralized", "");
    copy(&thermometer(), &office.plugins_folder().join("thermometer"));
    let before = await_state(&office, "thermometer", "running");
    send("-KILL", &pid(&before));
    let after = await_status(&office, "thermometer", |status| {
        status["state"] == "running" && status["pid"] != before["pid"]
    });
    assert_eq!(after["restarts"], 1, "{after}");
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(known-temperature office2)"]);
    assert_eq!(code, Some(0), "{said}");

    office.kill("daemon");
    await_none_left(&office);
}

#[test]
fn a_frozen_plugin_is_restarted_with_a_reason() {
    if !has_python() {
        return;
    }
    let office = office("decentralized", "");
    copy(&thermometer(), &office.plugins_folder().join("thermometer"));
    let before = await_state(&office, "thermometer", "running");
    send("-STOP", &pid(&before));
    let frozen = await_status(&office, "thermometer", |status| {
        status["reason"].as_str().is_some_and(|why| why.starts_with("its agents are silent"))
    });
    assert_eq!((&frozen["state"], &frozen["pid"]), (&before["state"], &before["pid"]), "{frozen}");
    let after = await_status(&office, "thermometer", |status| {
        status["state"] == "running" && status["pid"] != before["pid"]
    });
    assert_eq!(after["restarts"], 1, "{after}");
    let (code, said) = office.ask(&["goal", "(known-temperature office2)"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(office.ask(&["plugin", "disable", "thermometer"]).0, Some(0));
    await_none_left(&office);
}

#[test]
fn agents_of_the_file_get_their_config_and_others_are_listed() {
    if !has_python() {
        return;
    }
    let entry = |name: &str, room: &str, celsius: f64| {
        format!(
            "[[agent]]\nname = \"{name}\"\npackage = \"thermometer\"\n\
             config = {{ location = \"{room}\", celsius = {celsius} }}\n\n"
        )
    };
    let listed = "[plugins]\nadmit = \"listed\"\n\n".to_owned();
    let file = listed + &entry("t-1", "office1", 18.25) + &entry("t-2", "office2", 19.5);
    let named = office("decentralized", &file);
    copy(&thermometer(), &named.plugins_folder().join("thermometer"));
    named.await_devices(2);
    for (room, celsius) in [("office1", "18.2 °C"), ("office2", "19.5 °C")] {
        let (code, said) = named.ask(&["goal", &format!("(known-temperature {room})")]);
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains(celsius.trim_end_matches(" °C")), "{said}");
    }
    // The package's own agent is not started if the file names others. All of these joined at the
    // first start.
    let status = status(&named, "thermometer");
    assert_eq!(status["agents"].as_array().map(Vec::len), Some(2), "{status}");
    assert_eq!(status["restarts"], 0, "{status}");

    let listed = office("decentralized", "[plugins]\nadmit = \"listed\"\n");
    copy(&thermometer(), &listed.plugins_folder().join("thermometer"));
    let unused = await_state(&listed, "thermometer", "unused");
    assert!(unused["reason"].to_string().contains("listed"), "{unused}");
    let (code, said) = listed.ask(&["agents", "--discovered"]);
    assert_eq!(code, Some(0), "{said}");
    for expected in
        ["# py-1: does not take part", "package = \"thermometer\"", "location = \"office2\""]
    {
        assert!(said.contains(expected), "{expected}: {said}");
    }
}

#[test]
fn with_admission_by_consent_a_person_admits_a_plugin() {
    if !has_python() {
        return;
    }
    let ask =
        "[[agent]]\nname = \"keyboard\"\nplugin = \"keyboard\"\n\n[plugins]\nadmit = \"ask\"\n";
    let office = office("decentralized", ask);
    put(&office, "friend", &|_| ());
    let status = await_state(&office, "friend", "unused");
    assert_eq!(status["reason"], "a person is being asked: althing keyboard");
    assert_eq!(status["version"], "0.1.0", "a person sees what asks to be let in");
    office.answer("`friend` (a plugin, with agent-of-friend) has appeared", "yes");
    await_state(&office, "friend", "running");
    put(&office, "stranger", &|_| ());
    office.answer("`stranger` (a plugin, with agent-of-stranger) has appeared", "no");
    let is_denied =
        |status: &Value| status["reason"] == "a person has refused it; name it in the file";
    await_status(&office, "stranger", is_denied);
    office.await_devices(1);
}

#[test]
fn an_upgrade_takes_over_and_a_broken_one_is_rolled_back() {
    if !has_python() {
        return;
    }
    let office = office("decentralized", "");
    let next = office.folder().join("next/thermometer");
    copy(&thermometer(), &next);
    let package = next.display().to_string();
    assert_eq!(office.ask(&["plugin", "add", &package]).0, Some(0));
    await_state(&office, "thermometer", "running");
    let version = |expected: &'static str| {
        move |status: &Value| status["version"] == expected && status["state"] == "running"
    };

    replace(&next.join("plugin.toml"), "version = \"0.1.0\"", "version = \"0.2.0\"");
    replace(&next.join("agent.py"), "22.5", "23.5");
    let (code, said) = office.ask(&["plugin", "add", &package]);
    assert!(said.contains("added thermometer 0.2.0 in place of 0.1.0"), "{code:?} {said}");
    await_status(&office, "thermometer", version("0.2.0"));
    office.await_devices(1);
    let (_, said) = office.ask(&["goal", "(known-temperature office2)"]);
    assert!(said.contains("23.5 °C"), "{said}");

    replace(&next.join("plugin.toml"), "version = \"0.2.0\"", "version = \"0.3.0\"");
    fs::write(next.join("agent.py"), "raise SystemExit('it is broken')").expect("a file");
    assert_eq!(office.ask(&["plugin", "add", &package]).0, Some(0));
    let status = await_status(&office, "thermometer", |status| {
        version("0.2.0")(status) && !status["reason"].is_null()
    });
    let reason = status["reason"].as_str().unwrap_or_default();
    assert!(reason.contains("rolled back") && reason.contains("it is broken"), "{reason}");
    office.await_devices(1);

    fs::write(next.join("plugin.toml"), "name = \"thermometer\"\n").expect("a file");
    let (code, said) = office.ask(&["plugin", "add", &package]);
    assert_eq!(code, Some(33), "what is not whole is not added: {said}");
    assert!(said.contains("`version` is missing"), "{said}");
}

/// Adds a package with these files by `althing plugin add`. Its program is `./agent`, which has all the
/// time that it wants to get ready.
fn add_package(office: &Office, name: &str, version: &str, agent: &str) {
    let folder = office.folder().join("made").join(name);
    fs::create_dir_all(&folder).expect("a folder");
    let text = format!(
        "name = \"{name}\"\nversion = \"{version}\"\nprotocol = \"2\"\nrun = [\"./agent\"]\n\
         ready-within = \"10m\"\n\n[[agent]]\nname = \"agent-of-{name}\"\n"
    );
    fs::write(folder.join("plugin.toml"), text).expect("a file");
    fs::write(folder.join("agent"), agent).expect("a file");
    fs::set_permissions(folder.join("agent"), Permissions::from_mode(0o755)).expect("our own");
    let (code, said) = office.ask(&["plugin", "add", &folder.display().to_string()]);
    assert_eq!(code, Some(0), "{said}");
}

/// Waits until a file contains a text.
fn await_text(file: &Path, text: &str) {
    let deadline = Instant::now() + PATIENCE;
    while !fs::read_to_string(file).is_ok_and(|said| said.contains(text)) {
        assert!(Instant::now() < deadline, "`{text}` is not in {}", file.display());
        std::thread::yield_now();
    }
}

#[test]
fn a_package_that_comes_back_while_its_process_ends_runs_again() {
    let office = office("decentralized", "");
    // The process notes that it is to end, and goes on until it is killed.
    let stubborn = "#!/bin/sh\ntrap 'echo told >> $HOME/told' TERM\necho begun >> $HOME/told\n\
                    while :; do sleep 1; done\n";
    add_package(&office, "stubborn", "1", stubborn);
    let before = await_status(&office, "stubborn", |status| !status["pid"].is_null());
    let told = office.folder().join("state/lab/daemon/plugins/stubborn/told");
    await_text(&told, "begun");
    let (code, said) = office.ask(&["plugin", "remove", "stubborn"]);
    assert_eq!(code, Some(0), "{said}");
    await_text(&told, "told");
    add_package(&office, "stubborn", "2", stubborn);
    let after = await_status(&office, "stubborn", |status| {
        !status["pid"].is_null() && status["pid"] != before["pid"]
    });
    let expected: Value = serde_json::json!(["2", "starting", 0]);
    let found = serde_json::json!([after["version"], after["state"], after["restarts"]]);
    assert_eq!(found, expected, "{after}");
    let (code, said) = office.ask(&["plugin", "remove", "stubborn"]);
    assert_eq!(code, Some(0), "{said}");
    await_status(&office, "stubborn", Value::is_null);
    await_none_left(&office);
}

#[test]
fn an_upgrade_whose_program_cannot_be_started_is_rolled_back() {
    let office = office("decentralized", "");
    add_package(&office, "steady", "1", "#!/bin/sh\nexec sleep 600\n");
    await_status(&office, "steady", |status| !status["pid"].is_null());
    let shell = office.folder().join("a-shell");
    fs::copy("/bin/sh", &shell).expect("a program");
    add_package(&office, "steady", "2", &format!("#!{}\nexec sleep 600\n", shell.display()));
    await_text(&office.plugins_folder().join(".steady.failed/plugin.toml"), "version = \"2\"");
    let (_, said) = office.ask(&["plugin", "logs", "steady"]);
    assert!(said.contains("rolled back") && said.contains("the package may not read"), "{said}");
    await_status(&office, "steady", |status| status["version"] == "1" && !status["pid"].is_null());
}

/// Installs a package with a shell script as its program.
fn script(office: &Office, name: &str, text: &str, more: &str) {
    script_of(office, "sh", name, text, more);
}

/// Installs a package with a script for the shell `shell` as its program.
fn script_of(office: &Office, shell: &str, name: &str, script: &str, more: &str) {
    let folder = office.folder().join("made").join(name);
    fs::create_dir_all(&folder).expect("a folder");
    let text = format!(
        "name = \"{name}\"\nversion = \"1\"\nprotocol = \"2\"\nrun = [\"{shell}\", \"-c\", '''{script}''']\n\
         ready-within = \"2s\"\n\n[[agent]]\nname = \"agent-of-{name}\"\n\n{more}"
    );
    fs::write(folder.join("plugin.toml"), text).expect("a file");
    fs::rename(&folder, office.plugins_folder().join(name)).expect("the same file system");
}

/// Returns a program as version managers install it: a script that asks the manager, in a hidden
/// folder, and runs the program that it names.
fn shim(office: &Office, name: &str, real: &str) -> PathBuf {
    let root = office.folder().join("manager");
    let (shims, libexec) = (root.join("shims"), root.join("libexec"));
    for folder in [&shims, &libexec] {
        fs::create_dir_all(folder).expect("a folder");
    }
    let write = |file: &Path, text: &str| {
        fs::write(file, text).expect("a file");
        fs::set_permissions(file, Permissions::from_mode(0o755)).expect("our own");
    };
    let (shown, manager) = (root.display(), libexec.join("versions"));
    write(
        &shims.join(name),
        &format!(
            "#!/usr/bin/env bash\nset -e\nprogram=\"${{0##*/}}\"\nexport VERSIONS_ROOT=\"{shown}\"\n\
             exec \"{}\" exec \"$program\" \"$@\"\n",
            manager.display()
        ),
    );
    write(
        &manager,
        &format!(
            "#!/bin/sh\n[ \"$VERSIONS_ROOT\" = {shown} ] || exit 9\ncommand=$1\nshift 2\n\
             case $command in which) echo {real} ;; exec) exec {real} \"$@\" ;; *) exit 1 ;; esac\n"
        ),
    );
    shims
}

#[test]
fn a_program_that_is_a_shim_of_a_version_manager_runs() {
    let office = Office::new();
    let shims = shim(&office, "a-shell-of-some-version", "/bin/sh");
    let file = office.write("lab.toml", &lab("decentralized"));
    let mut office = office.with_file(file).with_programs(&shims);
    office.up(&["daemon"], &[]);
    script_of(&office, "a-shell-of-some-version", "shimmed", "echo it ran >&2; exit 3", "");
    await_status(&office, "shimmed", |status| {
        status["reason"].as_str().is_some_and(|why| why.contains("exit code 3: it ran"))
    });
    let (code, said) = office.ask(&["plugin", "logs", "shimmed"]);
    assert!(code == Some(0) && said.contains("which stands for /bin/sh"), "{said}");
}

#[test]
fn a_check_starts_the_program_and_explains_a_failure() {
    let office = office("decentralized", "");
    let folder = |name: &str| office.plugins_folder().join(name).display().to_string();
    for (name, program, expected, help) in [
        ("exits", "echo it is broken >&2; exit 3", "exit code 3: it is broken", None),
        ("hidden", "cat /etc/shadow; exit 126", "exit code 126: cat: ", Some("[permissions] read")),
        ("idle", "exec sleep 600", "`agent-of-idle` did not join within 2s", Some("first line")),
        (
            "module",
            "echo \"No module named 'zenoh'\" >&2; exit 1",
            "",
            Some("install `eclipse-zenoh`"),
        ),
    ] {
        script(&office, name, program, "");
        let output = office.run(&["plugin", "check", &folder(name)]);
        let said = crate::support::stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(output.status.code(), Some(33), "{name}: {said}");
        assert!(said.contains("it does not start") && said.contains(expected), "{name}: {said}");
        assert!(help.is_none_or(|help| said.contains(help)), "{name}: {said}");
        let output = office.run(&["plugin", "check", "--files-only", &folder(name)]);
        assert_eq!(output.status.code(), Some(0), "{name}: {}", crate::support::stderr(&output));
    }
}

#[test]
fn a_misbehaving_plugin_is_ended_with_a_reason() {
    let office = office("decentralized", "");
    let memory = "[permissions]\nmemory = \"48MiB\"\n";
    let forks = "for i in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17; do sleep 600 & done; wait";
    let disk = "[permissions]\ndisk = \"1MiB\"\n";
    let hoards = "for i in 1 2 3; do head -c 900000 /dev/zero > $HOME/$i; done; echo kept >&2; exec sleep 600";
    // The text of some cases depends on features of the kernel.
    let cases = [
        ("exits", "echo it is broken >&2; exit 3", "", "exit code 3: it is broken"),
        ("garbage", "while :; do head -c 4096 /dev/urandom; done", "", "did not join within 2s"),
        ("hangs", "exec sleep 600", "", "`agent-of-hangs` did not join within 2s"),
        ("stubborn", "trap '' TERM; while :; do sleep 1; done", "", "did not join within 2s"),
        ("forks", forks, "", "it has 18 processes, and may have 16|fork"),
        ("greedy", "exec tail /dev/zero", memory, "MiB of memory, and may hold 48"),
        ("hoards", hoards, disk, " MiB on disk, in "),
        ("fills", "exec head -c 2000000 /dev/zero > $HOME/all", disk, "ended by signal 25"),
        ("curious", "cat /etc/shadow", "", "Permission denied|No such file"),
        ("leaves", "exec setsid sleep 600", "", "Operation not permitted"),
    ];
    for (name, program, more, _) in cases {
        script(&office, name, program, more);
    }
    for (name, _, _, expected) in cases {
        await_status(&office, name, |status| {
            let reason = status["reason"].as_str().unwrap_or_default();
            let is_it = expected.split('|').any(|expected| reason.contains(expected));
            is_it && status["restarts"].as_u64() >= Some(1)
        });
    }
    // The host gives the plugin up in the end, and a person can enable it again.
    await_state(&office, "exits", "given-up");
    let (code, said) = office.ask(&["plugin", "enable", "exits"]);
    assert_eq!(code, Some(0), "{said}");
    await_status(&office, "exits", |status| status["state"] != "given-up");
    for (name, ..) in cases {
        assert_eq!(office.ask(&["plugin", "disable", name]).0, Some(0));
        await_state(&office, name, "disabled");
    }
    await_none_left(&office);
    let (code, said) = office.ask(&["plugin", "logs", "exits", "-n", "5"]);
    assert!(code == Some(0) && said.contains("it is broken"), "{said}");
    // The rest of the building was not disturbed.
    let (code, said) = office.ask(&["agents"]);
    assert!(code == Some(0) && said.contains("plan-executor"), "{said}");
}

#[test]
fn processor_time_of_children_counts() {
    let office = office("decentralized", "");
    // Each child computes for a moment and is gone before any check sees it.
    let burns = "while :; do (i=0; while [ $i -lt 20000 ]; do i=$((i+1)); done); done";
    script(&office, "burns", burns, "[permissions]\ncpu = 0.02\n");
    let manifest = office.plugins_folder().join("burns/plugin.toml");
    replace(&manifest, "ready-within = \"2s\"", "ready-within = \"10m\"");
    await_status(&office, "burns", |status| {
        let reason = status["reason"].as_str().unwrap_or_default();
        reason.contains("% of a core, and may take 2 %")
    });
}

#[test]
fn rights_are_allowed_by_a_person_before_a_plugin_runs() {
    let office = office("decentralized", "");
    let asks = "[permissions]\nnetwork = true\nmemory = \"160MiB\"\n";
    // A package that was copied by hand waits, because no person has allowed its rights.
    script(&office, "copied", "exit 3", asks);
    let status = await_state(&office, "copied", "not-allowed");
    let reason = status["reason"].as_str().unwrap_or_default();
    assert!(reason.contains("network memory=160MiB"), "{reason}");
    let (code, said) = office.ask(&["plugin", "allow", "copied"]);
    assert_eq!(code, Some(77), "nobody can be asked: {said}");
    assert!(said.contains("to connect to the Internet"), "{said}");
    let (code, said) = office.ask(&[
        "plugin",
        "allow",
        "copied",
        "--allow",
        "network",
        "--allow",
        "memory=160MiB",
    ]);
    assert_eq!(code, Some(0), "{said}");
    await_status(&office, "copied", |status| {
        status["reason"].as_str().is_some_and(|why| why.contains("exit code 3"))
    });
    // A new version with the same rights is not asked about; one with more rights is.
    let add = |text: &str, more: &[&str]| {
        let made = office.folder().join("made/copied");
        let _ = fs::remove_dir_all(&made);
        copy(&office.plugins_folder().join("copied"), &made);
        replace(&made.join("plugin.toml"), asks, text);
        let made = made.display().to_string();
        office.ask(&[&["plugin", "add", &made], more].concat())
    };
    assert_eq!(add(asks, &[]).0, Some(0));
    let grown = asks.replace("160MiB", "161MiB");
    let (code, said) = add(&grown, &[]);
    assert!(code == Some(77) && said.contains("--allow memory=161MiB"), "{said}");
    assert_eq!(add(&grown, &["--allow", "memory=161MiB"]).0, Some(0));
}

#[test]
fn a_folder_that_others_can_write_to_is_refused() {
    let office = office("decentralized", "");
    let mode = fs::metadata(office.plugins_folder()).expect("made").permissions().mode() & 0o777;
    assert_eq!(mode, 0o700, "whatever the umask");
    script(&office, "open", "exit 3", "");
    let package = office.plugins_folder().join("open");
    fs::set_permissions(&package, Permissions::from_mode(0o777)).expect("our own");
    let refused = |cure: &str| {
        let status = await_state(&office, "open", "invalid");
        let reason = status["reason"].as_str().unwrap_or_default();
        assert!(reason.contains("could run anything here") && reason.contains(cure), "{reason}");
    };
    refused("chmod -R go-w");
    fs::set_permissions(&package, Permissions::from_mode(0o755)).expect("our own");
    await_status(&office, "open", |status| {
        status["reason"].as_str().is_some_and(|why| why.contains("exit code 3"))
    });
    fs::set_permissions(office.plugins_folder(), Permissions::from_mode(0o777)).expect("our own");
    let (code, said) = office.ask(&["plugin", "add", &package.display().to_string()]);
    assert!(code != Some(0) && said.contains("other users can write to it"), "{said}");
}

#[test]
fn a_flooding_plugin_is_slowed_and_then_stopped() {
    if !has_python() {
        return;
    }
    let office = office("decentralized", "");
    let put = |name: &str, change: &dyn Fn(&Path)| put(&office, name, change);
    put("calm", &|_| ());
    put("floods", &|made| {
        replace(&made.join("agent.py"), "time.sleep(hello[\"heartbeat_period\"] / 1000)", "pass");
    });
    await_status(&office, "floods", |status| status["dropped"].as_u64() > Some(0));
    let (code, said) = office.ask(&["goal", "(known-temperature office2)"]);
    assert_eq!(code, Some(0), "{said}");
    let why = "it sent more messages than are accepted, for too long";
    let is_stopped = |status: &Value| {
        let reason = status["reason"].as_str().unwrap_or_default();
        reason.contains(why) && status["restarts"].as_u64() >= Some(1)
    };
    await_status(&office, "floods", is_stopped);
    let calm = status(&office, "calm");
    assert_eq!((&calm["state"], &calm["restarts"]), (&"running".into(), &0.into()), "{calm}");
}

#[test]
fn only_plugins_with_the_network_right_reach_the_network() {
    if !has_python() {
        return;
    }
    let office = office("decentralized", "");
    for (name, more) in [("silent", ""), ("online", "[permissions]\nnetwork = true\n")] {
        script(&office, name, "", more);
        let socket = "import socket; socket.socket(); raise SystemExit('it has a socket')";
        let run = format!("[\"python3\", \"-c\", \"{socket}\"]");
        let manifest = office.plugins_folder().join(name).join("plugin.toml");
        replace(&manifest, "[\"sh\", \"-c\", '''''']", &run);
    }
    let (code, said) = office.ask(&["plugin", "allow", "online", "--allow", "network"]);
    assert_eq!(code, Some(0), "{said}");
    let of = |name, expected: &'static str| {
        await_status(&office, name, move |status| {
            status["reason"].as_str().unwrap_or_default().contains(expected)
        })
    };
    of("silent", "Operation not permitted");
    of("online", "it has a socket");
}

#[test]
fn false_manifests_and_incomplete_packages_are_reported() {
    if !has_python() {
        return;
    }
    let office = office("decentralized", "");
    let put = |name: &str, change: &dyn Fn(&Path)| put(&office, name, change);
    let counts = "agent[\"sequence\"] += 1";
    put("liar", &|made| {
        let lies = "agent[\"model\"] = agent[\"model\"].replace(\"report-temperature\", \"open\")";
        replace(&made.join("agent.py"), counts, &format!("{counts}; {lies}"));
    });
    put("other", &|made| {
        let facts = "f\"(located {name} {room}) {agent['known']}\"";
        replace(&made.join("agent.py"), facts, "\"((\"");
    });
    put("undeclared", &|made| {
        replace(&made.join("plugin.toml"), "[action.report-temperature]", "[action.measure]");
    });
    put("newer", &|made| {
        replace(&made.join("plugin.toml"), "protocol = \"2\"", "protocol = \"7\"")
    });
    put("misconfigured", &|made| {
        replace(&made.join("plugin.toml"), "config = { location", "config = { place");
    });
    put("template", &|made| replace(&made.join("model.pddl"), "{{ agent }}", "{{ agents }}"));
    put("nothing", &|made| {
        replace(&made.join("plugin.toml"), "[\"python3\", \"agent.py\"]", "[\"./agent\"]");
    });
    for (name, state, expected) in [
        ("liar", "starting", "it offers `open`, and the manifest of `liar` has no"),
        ("other", "running", ""),
        (
            "undeclared",
            "invalid",
            "the manifest of `undeclared` has no [action.report-temperature]",
        ),
        ("newer", "invalid", "plugin.toml:4:12: the plugin speaks version 7 of the protocol"),
        ("misconfigured", "invalid", "config has no key `place`"),
        ("template", "invalid", "`agents` is not known here"),
        ("nothing", "invalid", "failed to find the program `./agent`"),
    ] {
        let status = await_status(&office, name, |status| {
            let reason = status["reason"].as_str().unwrap_or_default();
            status["state"] == state && reason.contains(expected)
        });
        let has_agent = status["agents"].as_array().is_some_and(|agents| !agents.is_empty());
        assert_eq!(has_agent, state == "running", "{status}");
    }
    // The conflicting part of a model is left out, and this is reported.
    put("conflicts", &|made| {
        replace(
            &made.join("model.pddl"),
            "(:objects",
            "(:predicates (located ?a - sensor)) (:objects",
        );
    });
    await_state(&office, "conflicts", "running");
    let deadline = Instant::now() + PATIENCE;
    while !office
        .ask(&["agents"])
        .1
        .contains("predicate `located` of `agent-of-conflicts`: the ontology")
    {
        assert!(Instant::now() < deadline, "{}", office.ask(&["agents"]).1);
    }
    fs::remove_dir_all(office.plugins_folder().join("conflicts")).expect("it was put in");
    // Facts that cannot be parsed are not believed; the others are planned with.
    office.await_devices(1);
    let (code, said) = office.ask(&["plugin", "list"]);
    assert_eq!(code, Some(0), "{said}");
    // Reasons are folded to the terminal's width; a test has no terminal.
    let table = said.lines().take_while(|line| !line.is_empty());
    let mut rows = table.filter(|line| !line.starts_with(' '));
    assert!(rows.all(|row| row.chars().count() <= 80), "{said}");
}

#[test]
fn a_built_in_plugin_runs_unchanged_as_a_process() {
    let agents = "[[agent]]\nname = \"t-1\"\npackage = \"sensors\"\nplugin = \"temperature-sensor\"\n\
                  config = { location = \"office1\" }\n\n\
                  [building.temperatures]\noffice1 = 18.5\n";
    for mode in ["decentralized", "centralized"] {
        let office = office(mode, agents);
        let package = office.plugins_folder().join("sensors");
        let made = office.folder().join("sensors");
        fs::create_dir(&made).expect("a folder");
        std::fs::copy(sensor_process(), made.join("sensor-process")).expect("a program");
        let machine = format!("{}-linux", std::env::consts::ARCH);
        let text = format!(
            "name = \"sensors\"\nversion = \"1\"\nprotocol = \"2\"\n\n[executable]\n\
             {machine} = \"sensor-process\"\n\n[action.report-temperature]\n\
             method = \"read_temperature\"\ntimeout = \"2s\"\n\n\
             [config.location]\ntype = \"text\"\n"
        );
        fs::write(made.join("plugin.toml"), text).expect("a file");
        fs::rename(&made, &package).expect("the same file system");
        await_state(&office, "sensors", "running");
        office.await_devices(1);
        let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert!(said.contains("18.5 °C at office1"), "the building's truth: {said}");
    }
}
