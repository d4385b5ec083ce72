//! A stand-in for an ONVIF camera, with the peculiarities of real ones on demand. It is a server of
//! its own, which shares no code with the client.

use std::collections::{BTreeSet, VecDeque};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Time for which a pull of messages waits.
const PULL: Duration = Duration::from_millis(300);

/// Greatest length of a request, in bytes.
const REQUEST_MAX: u64 = 1 << 20;

/// A picture: the beginning and the end of a JPEG.
const PICTURE: &[u8] = b"\xff\xd8\xff\xe0 a picture \xff\xd9";

/// A preset of the stand-in: its token, its name, and its position.
pub(crate) type Preset = (&'static str, &'static str, (f64, f64));

/// What the stand-in does, and what it has seen.
#[derive(Debug, Default)]
pub(crate) struct Behavior {
    /// How far its clock is ahead, in seconds.
    pub(crate) clock_offset: i64,
    /// Whether it accepts only logins whose time is that of its clock.
    pub(crate) checks_clock: bool,
    /// Whether it rejects every login.
    pub(crate) rejects_login: bool,
    /// Whether it wants HTTP Digest.
    pub(crate) wants_digest: bool,
    /// Whether its HTTP server offers nothing but Basic.
    pub(crate) wants_basic: bool,
    pub(crate) presets: Vec<Preset>,
    /// Whether it says its position.
    pub(crate) says_position: bool,
    pub(crate) position: (f64, f64),
    /// Operations that it does not have.
    pub(crate) unsupported: BTreeSet<&'static str>,
    /// Operations that it answers with garbage.
    pub(crate) garbles: BTreeSet<&'static str>,
    /// Operations that it never answers.
    pub(crate) silent: BTreeSet<&'static str>,
    /// Number of bytes of its picture, if it is not the usual one.
    pub(crate) picture_bytes: Option<usize>,
    /// Address of its video, if it is not one that nobody can reach.
    pub(crate) stream: Option<String>,
    /// Messages that wait for the next pull.
    messages: VecDeque<String>,
    /// Operations that it was asked for, with the body of each request.
    pub(crate) requests: Vec<(String, String)>,
}

/// A running stand-in. It ends with the test.
#[derive(Clone)]
pub(crate) struct StandIn {
    pub(crate) address: SocketAddr,
    behavior: Arc<(Mutex<Behavior>, Condvar)>,
}

impl StandIn {
    /// Starts a camera with two presets, which says its position.
    pub(crate) fn start() -> StandIn {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let behavior = Behavior {
            presets: vec![("1", "Hall", (0.5, 0.1)), ("2", "Door", (-0.5, 0.0))],
            says_position: true,
            ..Behavior::default()
        };
        let stand_in =
            StandIn { address, behavior: Arc::new((Mutex::new(behavior), Condvar::new())) };
        let serving = stand_in.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let serving = serving.clone();
                std::thread::spawn(move || serving.serve(stream));
            }
        });
        stand_in
    }

    /// Returns what the camera does, to look at it and to change it.
    pub(crate) fn behavior(&self) -> MutexGuard<'_, Behavior> {
        self.behavior.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns how often an operation was asked for.
    pub(crate) fn count(&self, operation: &str) -> usize {
        self.behavior().requests.iter().filter(|(name, _)| name == operation).count()
    }

    /// Reports motion, or its end.
    pub(crate) fn report_motion(&self, is_motion: bool) {
        let message = format!(
            "<wsnt:NotificationMessage><wsnt:Topic>tns1:RuleEngine/CellMotionDetector/Motion\
             </wsnt:Topic><wsnt:Message><tt:Message UtcTime=\"2026-01-01T00:00:00Z\"><tt:Source>\
             <tt:SimpleItem Name=\"VideoSourceConfigurationToken\" Value=\"vsc0\"/></tt:Source>\
             <tt:Data><tt:SimpleItem Name=\"IsMotion\" Value=\"{is_motion}\"/></tt:Data>\
             </tt:Message></wsnt:Message></wsnt:NotificationMessage>"
        );
        self.behavior().messages.push_back(message);
        self.behavior.1.notify_all();
    }

    fn serve(&self, stream: TcpStream) -> Option<()> {
        let mut reader = BufReader::new(stream.try_clone().ok()?);
        let mut head = Vec::new();
        loop {
            let mut line = String::new();
            reader.by_ref().take(REQUEST_MAX).read_line(&mut line).ok()?;
            if line.trim().is_empty() {
                break;
            }
            head.push(line.trim().to_owned());
        }
        let header = |name: &str| {
            let found = head.iter().find_map(|line| {
                let (key, value) = line.split_once(':')?;
                key.eq_ignore_ascii_case(name).then(|| value.trim().to_owned())
            });
            found.unwrap_or_default()
        };
        let length: u64 = header("Content-Length").parse().unwrap_or(0);
        let mut body = String::new();
        reader.take(length.min(REQUEST_MAX)).read_to_string(&mut body).ok()?;
        let is_get = head.first()?.starts_with("GET");
        let answer = self.answer(is_get, &header("Authorization"), &body)?;
        (&stream).write_all(&answer).ok()
    }

    /// Returns the answer to a request; `None` if there is none.
    fn answer(&self, is_get: bool, authorization: &str, body: &str) -> Option<Vec<u8>> {
        let operation = if is_get { "picture".to_owned() } else { operation(body)? };
        let mut behavior = self.behavior();
        behavior.requests.push((operation.clone(), body.to_owned()));
        let name = operation.as_str();
        if behavior.silent.contains(name) {
            drop(behavior);
            std::thread::sleep(Duration::from_secs(60));
            return None;
        }
        let needs_login = name != "GetSystemDateAndTime";
        if behavior.wants_basic && needs_login {
            return Some(http(401, "WWW-Authenticate: Basic realm=\"x\"\r\n", "text/plain", b""));
        }
        if behavior.wants_digest && needs_login && !authorization.contains("response=") {
            let challenge =
                "WWW-Authenticate: Digest realm=\"cam\", nonce=\"n1\", qop=\"auth\"\r\n";
            return Some(http(401, challenge, "text/plain", b""));
        }
        if needs_login && !is_get && !behavior.accepts(body) {
            return Some(soap(400, &fault("ter:NotAuthorized", "Sender not authorized")));
        }
        if behavior.garbles.contains(name) {
            return Some(http(200, "", "text/xml", b"<s:Envelope><s:Body><oops"));
        }
        if behavior.unsupported.contains(name) {
            return Some(soap(500, &fault("ter:ActionNotSupported", "no such operation")));
        }
        if is_get {
            let picture = behavior.picture_bytes.map(|bytes| vec![0xff; bytes]);
            let picture = picture.unwrap_or_else(|| PICTURE.to_vec());
            return Some(http(200, "", "image/jpeg", &picture));
        }
        if name == "PullMessages" {
            let wait = self
                .behavior
                .1
                .wait_timeout_while(behavior, PULL, |behavior| behavior.messages.is_empty());
            let mut behavior = wait.unwrap_or_else(PoisonError::into_inner).0;
            let messages: String = behavior.messages.drain(..).collect();
            return Some(soap(
                200,
                &format!(
                    "<tev:PullMessagesResponse>{messages}\
                 </tev:PullMessagesResponse>"
                ),
            ));
        }
        let (status, content) = behavior.content(self.address, name, body);
        Some(soap(status, &content))
    }
}

impl Behavior {
    fn accepts(&self, body: &str) -> bool {
        if self.rejects_login {
            return false;
        }
        if !self.checks_clock {
            return true;
        }
        let created = between(body, "Created>", "</").unwrap_or_default();
        let now = clock(self.clock_offset);
        // The minute is enough: the test does not run for longer.
        created.get(..14) == now.get(..14)
    }

    fn content(&mut self, address: SocketAddr, name: &str, body: &str) -> (u16, String) {
        // The host is one that a client cannot reach, as it is of a camera behind a router.
        let service = |name: &str| format!("http://192.0.2.1:{}/onvif/{name}", address.port());
        let content = match name {
            "GetSystemDateAndTime" => date_and_time(self.clock_offset),
            "GetServices" => [
                ("http://www.onvif.org/ver10/media/wsdl", "media"),
                ("http://www.onvif.org/ver20/ptz/wsdl", "ptz"),
                ("http://www.onvif.org/ver10/events/wsdl", "events"),
            ]
            .iter()
            .map(|(namespace, path)| {
                format!(
                    "<tds:Service><tds:Namespace>{namespace}</tds:Namespace>\
                     <tds:XAddr>{}</tds:XAddr></tds:Service>",
                    service(path)
                )
            })
            .collect(),
            "GetCapabilities" => format!(
                "<tds:Capabilities><tt:Events><tt:XAddr>{}</tt:XAddr></tt:Events><tt:Media>\
                 <tt:XAddr>{}</tt:XAddr></tt:Media><tt:PTZ><tt:XAddr>{}</tt:XAddr></tt:PTZ>\
                 </tds:Capabilities>",
                service("events"),
                service("media"),
                service("ptz")
            ),
            "GetDeviceInformation" => "<tds:Manufacturer>Stand</tds:Manufacturer>\
                                       <tds:Model>In</tds:Model>"
                .to_owned(),
            "GetProfiles" => "<trt:Profiles token=\"fixed\"><tt:Name>fixed</tt:Name>\
                <tt:VideoSourceConfiguration token=\"vsc9\"><tt:SourceToken>vs9</tt:SourceToken>\
                </tt:VideoSourceConfiguration></trt:Profiles><trt:Profiles token=\"main\">\
                <tt:Name>main</tt:Name><tt:VideoSourceConfiguration token=\"vsc0\"><tt:SourceToken>\
                vs0</tt:SourceToken></tt:VideoSourceConfiguration><tt:PTZConfiguration token=\"p\">\
                <tt:NodeToken>node</tt:NodeToken></tt:PTZConfiguration></trt:Profiles>"
                .to_owned(),
            "GetNodes" => "<tptz:PTZNode token=\"node\"><tt:SupportedPTZSpaces>\
                <tt:AbsolutePanTiltPositionSpace/><tt:ContinuousPanTiltVelocitySpace/>\
                </tt:SupportedPTZSpaces><tt:MaximumNumberOfPresets>8</tt:MaximumNumberOfPresets>\
                </tptz:PTZNode>"
                .to_owned(),
            "GetPresets" => self.presets.iter().map(|preset| self.preset(preset)).collect(),
            "GotoPreset" => {
                let token = between(body, "PresetToken>", "</").unwrap_or_default();
                match self.presets.iter().find(|(known, ..)| *known == token) {
                    Some((_, _, position)) => self.position = *position,
                    None => return (400, fault("ter:NoToken", "no such preset")),
                }
                String::new()
            }
            "AbsoluteMove" => {
                let number = |axis: &str| between(body, axis, "\"")?.parse().ok();
                if let (Some(pan), Some(tilt)) = (number("PanTilt x=\""), number(" y=\"")) {
                    self.position = (pan, tilt);
                }
                String::new()
            }
            "GetStatus" => {
                let position = self.says_position.then(|| vector(self.position));
                format!(
                    "<tptz:PTZStatus>{}<tt:MoveStatus><tt:PanTilt>IDLE</tt:PanTilt>\
                     </tt:MoveStatus></tptz:PTZStatus>",
                    position
                        .map(|at| format!("<tt:Position>{at}</tt:Position>"))
                        .unwrap_or_default()
                )
            }
            "GetSnapshotUri" => {
                format!("<trt:MediaUri><tt:Uri>{}</tt:Uri></trt:MediaUri>", service("picture"))
            }
            "GetStreamUri" => {
                let uri = self.stream.as_deref().unwrap_or("rtsp://192.0.2.1:8554/live");
                format!("<trt:MediaUri><tt:Uri>{uri}</tt:Uri></trt:MediaUri>")
            }
            "CreatePullPointSubscription" => format!(
                "<tev:SubscriptionReference><wsa:Address>{}</wsa:Address>\
                 <wsa:ReferenceParameters><x:Id xmlns:x=\"urn:x\">7</x:Id>\
                 </wsa:ReferenceParameters></tev:SubscriptionReference>",
                service("pull")
            ),
            _ => String::new(),
        };
        (200, format!("<{name}Response>{content}</{name}Response>"))
    }

    fn preset(&self, (token, name, position): &Preset) -> String {
        let position = self.says_position.then(|| vector(*position));
        let position = position.map(|at| format!("<tt:PTZPosition>{at}</tt:PTZPosition>"));
        format!(
            "<tptz:Preset token=\"{token}\"><tt:Name>{name}</tt:Name>{}</tptz:Preset>",
            position.unwrap_or_default()
        )
    }
}

fn vector((pan, tilt): (f64, f64)) -> String {
    format!("<tt:PanTilt x=\"{pan}\" y=\"{tilt}\"/><tt:Zoom x=\"0\"/>")
}

fn between<'t>(text: &'t str, start: &str, end: &str) -> Option<&'t str> {
    let (_, rest) = text.split_once(start)?;
    rest.split_once(end).map(|(found, _)| found)
}

/// Returns the name of the operation in a request.
fn operation(body: &str) -> Option<String> {
    let name = between(body, "Body><", ">")?;
    let name = name.split([' ', '/']).next()?;
    Some(name.rsplit(':').next()?.to_owned())
}

fn soap(status: u16, content: &str) -> Vec<u8> {
    let text = format!(
        "<?xml version=\"1.0\"?><s:Envelope xmlns:s=\"http://www.w3.org/2003/05/soap-envelope\" \
         xmlns:wsa=\"http://www.w3.org/2005/08/addressing\" xmlns:tt=\"urn:tt\" \
         xmlns:tds=\"urn:tds\" xmlns:trt=\"urn:trt\" xmlns:tptz=\"urn:tptz\" xmlns:tev=\"urn:tev\" \
         xmlns:wsnt=\"urn:wsnt\" xmlns:ter=\"urn:ter\"><s:Body>{content}</s:Body></s:Envelope>"
    );
    http(status, "", "application/soap+xml", text.as_bytes())
}

fn fault(code: &str, reason: &str) -> String {
    format!(
        "<s:Fault><s:Code><s:Value>s:Sender</s:Value><s:Subcode><s:Value>{code}</s:Value>\
         </s:Subcode></s:Code><s:Reason><s:Text>{reason}</s:Text></s:Reason></s:Fault>"
    )
}

fn http(status: u16, headers: &str, kind: &str, body: &[u8]) -> Vec<u8> {
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status} OK\r\n{headers}Content-Type: {kind}\r\nContent-Length: {length}\r\n\
         Connection: close\r\n\r\n"
    );
    [head.as_bytes(), body].concat()
}

/// Returns the time that a clock shows which is `offset` seconds ahead, as ISO 8601.
fn clock(offset: i64) -> String {
    let (year, month, day, seconds) = civil(offset);
    format!(
        "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z",
        seconds / 3_600,
        seconds / 60 % 60,
        seconds % 60
    )
}

fn date_and_time(offset: i64) -> String {
    let (year, month, day, seconds) = civil(offset);
    format!(
        "<tds:SystemDateAndTime><tt:UTCDateTime><tt:Time><tt:Hour>{}</tt:Hour><tt:Minute>{}\
         </tt:Minute><tt:Second>{}</tt:Second></tt:Time><tt:Date><tt:Year>{year}</tt:Year>\
         <tt:Month>{month}</tt:Month><tt:Day>{day}</tt:Day></tt:Date></tt:UTCDateTime>\
         </tds:SystemDateAndTime>",
        seconds / 3_600,
        seconds / 60 % 60,
        seconds % 60
    )
}

/// Returns year, month, day, and the seconds of the day, of a clock that is `offset` seconds ahead.
fn civil(offset: i64) -> (i64, i64, i64, i64) {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970").as_secs();
    let now = i64::try_from(now).expect("a small number") + offset;
    let (mut days, seconds) = (now.div_euclid(86_400), now.rem_euclid(86_400));
    let is_leap = |year: i64| year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let mut year = 1970;
    while days >= 365 + i64::from(is_leap(year)) {
        days -= 365 + i64::from(is_leap(year));
        year += 1;
    }
    let lengths = [31, 28 + i64::from(is_leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 1;
    for length in lengths {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    (year, month, days + 1, seconds)
}
