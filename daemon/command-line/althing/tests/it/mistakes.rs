//! Mistakes of a user in the files of a school: each is reported once, at its place, with a
//! correction, and nothing else is reported.

use serde_json::Value;

use crate::sandbox::Sandbox;

pub(crate) const SCHOOL: &str = r#"[ecosystem]
name = "village-school"
domain = "../words/domain.pddl"
problem = "../words/school.pddl"
mode = "centralized"

[[agent]]
name = "domain-maintainer"
plugin = "domain-maintainer"
daemon = "office-pc"

[[agent]]
name = "plan-requester"
plugin = "plan-requester"
daemon = "office-pc"

[[agent]]
name = "planning-agent"
plugin = "planning-agent"
daemon = "office-pc"

[[agent]]
name = "plan-executor"
plugin = "plan-executor"
daemon = "office-pc"

[[agent]]
name = "thermometer-a"
plugin = "temperature-sensor"
daemon = "class-a-pi"
config = { location = "class-a" }

[[agent]]
name = "air-b"
plugin = "sensor"
daemon = "class-b-pi"
config = { quantity = "co2", location = "class-b", valid-for = "10m" }

[[agent]]
name = "camera-door"
plugin = "ptz-camera"
daemon = "entrance-pi"
config = { location = "entrance", presets = { door = { shows = "entrance" } } }

[[agent]]
name = "screen-door"
plugin = "screen"
daemon = "entrance-pi"
config = { location = "entrance", media = { menu = "Today: soup" } }

[[agent]]
name = "rover"
plugin = "turtlebot"
daemon = "rover-laptop"
config = { start = "passage", speed = 0.3 }

[[agent]]
name = "rover-eye"
plugin = "ir-temperature-sensor"
daemon = "rover-laptop"
config = { mounted-on = "rover" }

[goals]
warm = "(forall (?r - room) (known-temperature ?r))"
lunch = { goal = "(presented menu entrance)", keep = "maintain" }

[building]
temperatures = { class-a = 19.0, class-b = 20.0, entrance = 17.0 }
time-scale = 0.5
"#;

pub(crate) const MAP: &str = "\
(define (problem village-school-map)
  (:domain smart-office)
  (:objects
    class-a class-b entrance - room
    passage yard - corridor)
  (:init
    (= (total-cost) 0)
    (connected passage class-a) (= (distance passage class-a) 4)
    (connected class-a passage) (= (distance class-a passage) 4)
    (connected passage class-b) (= (distance passage class-b) 6)
    (connected class-b passage) (= (distance class-b passage) 6)
    (connected passage entrance) (= (distance passage entrance) 9)
    (connected entrance passage) (= (distance entrance passage) 9)
    (connected yard passage) (= (distance yard passage) 12)
    (connected passage yard) (= (distance passage yard) 12))
  (:goal (and)))
";

pub(crate) fn sandbox(school: &[u8], map: &[u8]) -> Sandbox {
    let words = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../domains/smart-office/domain.pddl");
    let words = std::fs::read_to_string(words).expect("the ontology of the repository");
    let sandbox = Sandbox::new(&[("words/domain.pddl", &words)]);
    sandbox.write("files/school.toml", school);
    sandbox.write("words/school.pddl", map);
    sandbox
}

/// Returns the errors and warnings about the files: severity, file and line, and message with help.
pub(crate) fn told(school: &str, map: &str) -> Vec<(String, String, String)> {
    let mut told = all_told(school, map);
    told.retain(|(severity, ..)| severity != "hint");
    told
}

/// Returns all reports on the files, hints included.
pub(crate) fn all_told(school: &str, map: &str) -> Vec<(String, String, String)> {
    let run = sandbox(school.as_bytes(), map.as_bytes()).run("check files/school.toml --json");
    let json = run.json();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let diagnostics = json["diagnostics"].as_array().expect("a list");
    let told = diagnostics.iter().map(|found| {
        let place = format!("{}:{}", text(&found["file"]), found["line"]);
        let (message, help) = (text(&found["message"]), text(&found["help"]));
        (text(&found["severity"]), place, format!("{message}; {help}"))
    });
    let told: Vec<_> = told.collect();
    let has_errors = told.iter().any(|(severity, ..)| severity == "error");
    assert_eq!(run.code, if has_errors { 33 } else { 0 }, "{told:#?}");
    told
}

/// Checks that one mistake in the ecosystem file is reported once.
#[track_caller]
pub(crate) fn file(from: &str, to: &str, severity: &str, line: usize, words: &[&str]) {
    assert!(SCHOOL.contains(from), "{from}");
    check(
        &SCHOOL.replacen(from, to, 1),
        MAP,
        severity,
        &format!("files/school.toml:{line}"),
        words,
    );
}

/// Checks that one mistake in the map is reported once.
#[track_caller]
pub(crate) fn map(from: &str, to: &str, severity: &str, line: usize, words: &[&str]) {
    assert!(MAP.contains(from), "{from}");
    check(
        SCHOOL,
        &MAP.replacen(from, to, 1),
        severity,
        &format!("words/school.pddl:{line}"),
        words,
    );
}

#[track_caller]
pub(crate) fn check(school: &str, map: &str, severity: &str, place: &str, words: &[&str]) {
    let told = told(school, map);
    let [(is, at, text)] = &told[..] else { panic!("one mistake is made: {told:#?}") };
    assert_eq!((is.as_str(), at.as_str()), (severity, place), "{text}");
    for word in words {
        assert!(text.contains(word), "no `{word}`: {text}");
    }
}

/// Returns `text` with the first `from` changed to `to`.
#[track_caller]
pub(crate) fn changed(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1)
}

pub(crate) const ERROR: &str = "error";
pub(crate) const WARNING: &str = "warning";

#[test]
fn a_correct_file_has_no_reports() {
    assert_eq!(told(SCHOOL, MAP), []);
    // The same with indentation, tabs, and encodings of other systems.
    let indented = SCHOOL.replace("\nname", "\n\t  name").replace(" = ", "\t=  ");
    assert_eq!(told(&indented, MAP), []);
    let windows = format!("\u{feff}{}", SCHOOL.replace('\n', "\r\n"));
    assert_eq!(told(&windows, &MAP.replace('\n', "\r\n")), []);
    let utf16 = |text: &str| -> Vec<u8> {
        let units = text.encode_utf16();
        [0xff, 0xfe].into_iter().chain(units.flat_map(u16::to_le_bytes)).collect()
    };
    sandbox(&utf16(SCHOOL), &utf16(MAP)).check("check files/school.toml", 0);
}

#[test]
fn the_map() {
    let back = "(connected class-b passage) (= (distance class-b passage) 6)";
    let cure = "write (connected class-b passage) (= (distance class-b passage) 6) too";
    map(back, "", WARNING, 10, &["a way leads from `passage` to `class-b`, and none back", cure]);
    map(
        "(= (distance passage class-a) 4)",
        "",
        WARNING,
        8,
        &["`passage` to `class-a` has no length", "(= (distance passage class-a) 4)"],
    );
    map("entrance - room", "entrance attic - room", WARNING, 4, &["no robot can reach `attic`"]);
    let minus = "(= (distance passage class-a) -4)";
    let words = ["from `passage` to `class-a` cannot be -4 m long", "more than 0"];
    map("(= (distance passage class-a) 4)", minus, ERROR, 8, &words);
    let far = "(= (distance passage class-a) 4000)";
    map("(= (distance passage class-a) 4)", far, ERROR, 8, &["`passage` and `class-a`", "1000 m"]);
    map("class-a class-b", "class-a, class-b", ERROR, 4, &["separate names by spaces"]);
    map(":domain smart-office", ":domain school", WARNING, 2, &["called `smart-office`"]);
}

#[test]
fn comments_of_the_author_suppress_warnings() {
    let back = "    (connected class-b passage) (= (distance class-b passage) 6)\n";
    let meant = MAP.replace(back, "").replace(
        "(connected passage class-b) (= (distance passage class-b) 6)",
        "(connected passage class-b) (= (distance passage class-b) 6)  ; one way: a slide",
    );
    assert_eq!(told(SCHOOL, &meant), []);
    let closed = MAP.replace("entrance - room", "entrance\n    boiler ; no way in\n    - room");
    assert_eq!(told(SCHOOL, &closed), []);
    // An airlock is passed in a round of one-way connections, so the way back exists.
    let airlock = MAP.replace("passage yard -", "passage yard lock-in lock-out -").replace(
        "    (= (total-cost) 0)\n",
        "    (= (total-cost) 0)
    (connected yard lock-in) (= (distance yard lock-in) 2)
    (connected lock-in lock-out) (= (distance lock-in lock-out) 2)
    (connected lock-out yard) (= (distance lock-out yard) 2)\n",
    );
    assert_eq!(told(SCHOOL, &airlock), []);
    // Without robots, places need not be reachable.
    let robots = SCHOOL.find("[[agent]]\nname = \"rover\"").expect("robots");
    let goals = SCHOOL.find("[goals]").expect("goals");
    let still = format!("{}{}", &SCHOOL[..robots], &SCHOOL[goals..]);
    let no_ways = MAP[..MAP.find("    (connected").expect("ways")].to_owned() + ") (:goal (and)))";
    assert_eq!(told(&still, &no_ways), []);
}

#[test]
fn roles_of_the_reasoning() {
    for role in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
        let entry =
            format!("[[agent]]\nname = \"{role}\"\nplugin = \"{role}\"\ndaemon = \"office-pc\"\n");
        let missing = format!("the file has no agent with plugin = \"{role}\"");
        let cure =
            format!("[[agent]]\nname = \"{role}\"\nplugin = \"{role}\"\ndaemon = \"office-pc\"");
        file(&entry, "", WARNING, 1, &[&missing, &cure]);
    }
    // In the decentralised flow no Planning Agent is needed.
    let entry = "[[agent]]\nname = \"planning-agent\"\nplugin = \"planning-agent\"\ndaemon = \"office-pc\"\n";
    let decentralized = SCHOOL.replace(entry, "").replace("\"centralized\"", "\"decentralized\"");
    assert_eq!(told(&decentralized, MAP), []);
    file(
        "name = \"domain-maintainer\"",
        "name = \"archive\"",
        WARNING,
        8,
        &["looked for by the name `domain-maintainer`", "name = \"domain-maintainer\""],
    );
    let renamed = SCHOOL.replace("name = \"plan-requester\"", "name = \"wishes\"");
    assert_eq!(told(&renamed, MAP), []);
}

#[test]
fn keys_and_values_of_entries() {
    let place = "config = { location = \"class-a\" }";
    let near = "did you mean `location`?";
    for key in ["lokation", "room", "Location"] {
        file(place, &format!("config = {{ {key} = \"class-a\" }}"), ERROR, 31, &[near]);
    }
    let beside = "config = { location = \"class-a\", driver = \"linux\" }";
    file(place, beside, ERROR, 31, &["no key `driver`", "stands beside `config`"]);
    let outside = "location = \"class-a\"";
    file(place, outside, ERROR, 31, &["write config = { location = \"class-a\" }"]);
    file(place, "config = { location = 5 }", ERROR, 31, &["a text in quotes", "is 5"]);
    file(place, "config = { location = \"Class-A\" }", ERROR, 31, &["write \"class-a\""]);
    file(place, "config = { location = \"class a\" }", ERROR, 31, &["did you mean `class-a`?"]);
    file(place, "config = { location = \"passage\" }", WARNING, 31, &["is a corridor", "room"]);
    file(
        place,
        "driver = \"gpio\"\nconfig = { location = \"class-a\" }",
        ERROR,
        32,
        &["driver `gpio` measures what is yes or no"],
    );
    let yes = "config = { location = \"class-a\", humidity = \"yes\" }";
    file(place, yes, ERROR, 31, &["true or false", "write humidity = true"]);

    let rover = "config = { start = \"passage\", speed = 0.3 }";
    let speed = |speed: &str| format!("config = {{ start = \"passage\", speed = {speed} }}");
    let words = ["`speed` must be a number", "write speed = 0.3, without quotes"];
    file(rover, &speed("\"0.3\""), ERROR, 55, &words);
    let words = ["write the number of meters per second: speed = 0.3"];
    file(rover, &speed("\"0.3 m/s\""), ERROR, 55, &words);
    file(rover, &speed("-1"), ERROR, 55, &["`rover`", "above zero"]);
    file(rover, "config = { speed = 0.3 }", ERROR, 55, &["`start` is missing", "write start = \""]);
    file(&format!("{rover}\n"), "", ERROR, 51, &["`start` is missing", "write start = \""]);
    file(rover, "config = { stat = \"passage\" }", ERROR, 55, &["`stat`", "did you mean `start`?"]);

    let air = "valid-for = \"10m\"";
    file(air, "valid-for = 10", ERROR, 37, &["a unit too", "valid-for = \"10s\""]);
    file(air, "valid-for = \"soon\"", ERROR, 37, &["a duration", "such as \"30s\""]);
    file(air, "valid_for = \"10m\"", ERROR, 37, &["did you mean `valid-for`?"]);
    file("quantity = \"co2\"", "quantity = \"CO2\"", ERROR, 37, &["did you mean `co2`?"]);

    file("shows = \"entrance\"", "shows = \"entrence\"", ERROR, 43, &["did you mean `entrance`?"]);
    let short = "presets = { door = \"entrance\" }";
    let long = "presets = { door = { shows = \"entrance\" } }";
    file(long, short, ERROR, 43, &["`presets.door` must be a table", "such as presets = {"]);
    file("mounted-on = \"rover\"", "mounted-on = \"rver\"", ERROR, 61, &["did you mean `rover`?"]);
    file("mounted-on = \"rover\"", "mounted-on = \"air-b\"", ERROR, 61, &["only a robot carries"]);
}

#[test]
fn all_mistakes_of_an_entry_are_reported() {
    let rover = "config = { start = \"passage\", speed = 0.3 }";
    let wrong = "config = { stat = \"passage\", speed = \"fast\" }";
    let told = told(&SCHOOL.replace(rover, wrong), MAP);
    let texts: Vec<_> = told.iter().map(|(_, _, text)| text.as_str()).collect();
    assert_eq!(texts.len(), 2, "{texts:#?}");
    assert!(texts[0].contains("`stat`") && texts[1].contains("`speed`"), "{texts:#?}");
}

#[test]
fn names() {
    let thermometer = "name = \"thermometer-a\"";
    file(thermometer, "name = \"thermometer a\"", ERROR, 28, &["`a-z`, `0-9`, `-` and `_`"]);
    file(thermometer, "name = \"air-b\"", ERROR, 34, &["two agents are called `air-b`"]);
    file(thermometer, "name = \"entrance\"", ERROR, 28, &["is on the map already"]);
    let plugin = "plugin = \"screen\"";
    file(plugin, "plugin = \"scren\"", ERROR, 47, &["did you mean `screen`?"]);
    file(plugin, "plugin = \"projector\"", ERROR, 47, &["unknown plugin `projector`", "screen"]);
    file(plugin, "plugin = \"screen\"\ndriver = \"hdmi\"", ERROR, 48, &["no driver `hdmi`"]);
    let daemon = "daemon = \"rover-laptop\"";
    let words = ["`rover-labtop` is named nowhere else", "did you mean `rover-laptop`?"];
    let twice = SCHOOL.replacen("daemon = \"rover-laptop\"\n", "daemon = \"rover-labtop\"\n", 1);
    let twice = format!("{twice}\n[[agent]]\nname = \"k\"\nplugin = \"keyboard\"\n{daemon}\n");
    check(&twice, MAP, WARNING, "files/school.toml:54", &words);
    // Of two similar names, the one with the name of a place in it is taken as right.
    file(
        "daemon = \"entrance-pi\"",
        "daemon = \"entrence-pi\"",
        WARNING,
        42,
        &["did you mean `entrance-pi`?"],
    );
    let listed = twice.replace("[ecosystem]\n", "[ecosystem]\ndaemons = [\"rover-labtop\"]\n");
    assert_eq!(told(&listed, MAP), []);
    file(daemon, "daemon = \"the laptop\"", ERROR, 54, &["cannot be the name of a daemon"]);
}

#[test]
fn goals_may_use_declarations_of_the_agents() {
    let lunch = "(presented menu entrance)";
    file(lunch, "(presented menue entrance)", ERROR, 65, &["did you mean `menu`?"]);
    file(lunch, "(presentd menu entrance)", ERROR, 65, &["did you mean `presented`?"]);
    file(lunch, "(presented menu passage)", ERROR, 65, &["`passage` is of type `corridor`"]);
    file(lunch, "(lit entrance)", WARNING, 65, &["unknown predicate `lit`", "the goal waits"]);
    let preset = SCHOOL.replace(lunch, "(looks-at camera-door door)");
    assert_eq!(told(&preset, MAP), []);
    // The objects of an entry that cannot be read are unknown.
    let media = "media = { menu = \"Today: soup\" }";
    file(media, "media = [\"menu\"]", ERROR, 49, &["`media` must be a table", "media = {"]);
}

#[test]
fn text_that_is_no_toml() {
    let name = "name = \"thermometer-a\"";
    file(name, "name = \"thermometer-a", ERROR, 28, &["a text is not closed"]);
    file(name, "name = thermometer-a", ERROR, 28, &["in quotes", "write \"thermometer-a\""]);
    file(name, "name = “thermometer-a”", ERROR, 28, &["quote", "a straight one"]);
    file(name, "name: \"thermometer-a\"", ERROR, 28, &["write name = \"thermometer-a\""]);
    file("speed = 0.3", "speed = 0,3", ERROR, 55, &["numbers have a point", "write 0.3"]);
    file("speed = 0.3", "speed = 0.3 m/s", ERROR, 55, &["write 0.3, the number alone"]);
    let comma = "config = { start = \"passage\" speed = 0.3 }";
    let rover = "config = { start = \"passage\", speed = 0.3 }";
    file(rover, comma, ERROR, 55, &["missing comma"]);
    let place = "config = { location = \"class-a\" }";
    file(
        place,
        "config = { location = \"class-a\"",
        ERROR,
        31,
        &["`{` is not closed", "write `}`"],
    );
    file(&format!("[[agent]]\n{name}"), &format!("[[agent]\n{name}"), ERROR, 27, &["[[agent]]"]);
    file(&format!("[[agent]]\n{name}"), &format!("[agent]\n{name}"), ERROR, 27, &["[[agent]]"]);
    file(&format!("[[agent]]\n{name}"), name, ERROR, 27, &["is there already", "[[agent]]"]);
    file(&format!("[[agent]]\n{name}"), &format!("[[agents]]\n{name}"), ERROR, 27, &["[[agent]]"]);
    file("[goals]", "// goals\n[goals]", ERROR, 63, &["a comment begins with `#`"]);
    file("[building]", "[goals]\n[building]", ERROR, 67, &["begins in line 63"]);
    file("class-a = 19.0", "class-ä = 19.0", ERROR, 68, &["another stands in quotes"]);
}

#[test]
fn tables_of_the_file() {
    file("mode = \"centralized\"", "mode = \"central\"", ERROR, 5, &["\"centralized\""]);
    file("keep = \"maintain\"", "keep = \"always\"", ERROR, 65, &["\"achieve\" or \"maintain\""]);
    file("class-a = 19.0", "class-a = \"19 C\"", ERROR, 68, &["without `C`"]);
    file("class-a = 19.0", "clas-a = 19.0", ERROR, 68, &["did you mean `class-a`?"]);
    file("time-scale", "time_scale", ERROR, 69, &["did you mean `time-scale`?"]);
    let mode = "mode = \"centralized\"\n";
    let list = "mode = \"centralized\"\ndaemons = \"attic\"\n";
    file(mode, list, ERROR, 6, &["write daemons = [\"attic\"]"]);
    file("../words/domain", "words/domain", ERROR, 3, &["did you mean `../words/domain.pddl`?"]);
    file("../words/domain.pddl", "../words", ERROR, 3, &["folder", "`../words/domain.pddl`"]);
    file(
        "../words/domain.pddl",
        "../words/school.pddl",
        ERROR,
        3,
        &["is a map", "(define (domain"],
    );
    file("../words/school", "../words/scool", ERROR, 4, &["did you mean `../words/school.pddl`?"]);
}

#[test]
fn the_network() {
    let zenoh = |line: &str| format!("{SCHOOL}[zenoh]\n{line}\n");
    for (line, words) in [
        ("listen.endpoints = [\"tls/[::]:744700\"]", &["no address", "a port from 0 to 65535"][..]),
        ("connect.endpoints = [\"office-pc:7447\"]", &["PROTOCOL/ADDRESS"]),
        ("connect.endpoints = [\"http://office-pc:7447\"]", &["not `http`"]),
        ("connect.endpoints = [\"tls/office-pc\"]", &["HOST:PORT"]),
        ("listen.endpoints = [\"tcp/0.0.0.0:7447\"]", &["plain TCP is for this machine alone"]),
        ("listen.endpoints = [\"tcp://127.0.0.1:7447\"]", &["write `tcp/127.0.0.1:7447`"]),
        ("listen.endpoint = [\"tls/[::]:7447\"]", &["did you mean `listen.endpoints`?"]),
        ("scouting = true", &["secure the ecosystem"]),
        ("listen_endpoints = [\"tls/[::]:7447\"]", &["did you mean `listen.endpoints`?"]),
    ] {
        check(&zenoh(line), MAP, ERROR, "files/school.toml:71", words);
    }
    assert_eq!(told(&zenoh("listen.endpoints = [\"tls/[::]:7447\"]"), MAP), []);
}

#[test]
fn files_that_are_not_there() {
    let sandbox = sandbox(SCHOOL.as_bytes(), MAP.as_bytes());
    let run = sandbox.check("check files/scool.toml", 33);
    // The output is wrapped at the width of a line.
    let said = run.stderr.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("did you mean `files/school.toml`?"), "{said}");
    let run = sandbox.check("check files", 33);
    assert!(run.stderr.contains("it is a folder; name a file in it"), "{}", run.stderr);
    // A file is recognised by its contents, whatever its extension.
    sandbox.write("school.txt", SCHOOL.replace("../words", "words").as_bytes());
    let run = sandbox.check("check school.txt", 0);
    assert!(run.stdout.contains("ecosystem village-school"), "{}", run.stdout);
}

/// `althing up` reports the same mistakes as `althing check`, before it starts anything.
#[test]
fn up_refuses_what_check_refuses() {
    let wrong = SCHOOL.replace("speed = 0.3", "speed = \"0.3\"");
    let sandbox = sandbox(wrong.as_bytes(), MAP.as_bytes());
    let run = sandbox.check("up files/school.toml --daemon rover-laptop", 78);
    assert!(run.stderr.contains("files/school.toml:55"), "{}", run.stderr);
    assert!(run.stderr.contains("write speed = 0.3, without quotes"), "{}", run.stderr);
}
