//! The functions of `libphidget22` that this crate calls. All `unsafe` code of the crate is here.
//!
//! [`LibraryFunctions`] and [`ChannelHandle`] document why the calls are sound; each call names the
//! reasons that it relies on. The types of the functions are those of Phidgets' `phidget22.h`.
#![expect(unsafe_code, reason = "a C library can be called in no other way")]

use std::ffi::{CStr, OsStr, c_char, c_double, c_int, c_void};
use std::ptr::{self, NonNull};
use std::time::Duration;

/// Pointer to a channel of `libphidget22`.
type RawChannel = *mut c_void;
/// Result of a call of the library (`PhidgetReturnCode`): 0 for success, or the number of an error.
type ReturnCode = c_int;

type CreateFn = unsafe extern "C" fn(*mut RawChannel) -> ReturnCode;
type ChannelFn = unsafe extern "C" fn(RawChannel) -> ReturnCode;
type SetIntFn = unsafe extern "C" fn(RawChannel, c_int) -> ReturnCode;
type GetIntFn = unsafe extern "C" fn(RawChannel, *mut c_int) -> ReturnCode;
type GetDoubleFn = unsafe extern "C" fn(RawChannel, *mut c_double) -> ReturnCode;

const TIMEOUT: ReturnCode = 3;
const NOT_ATTACHED: ReturnCode = 52;

/// Maximum length of the detail of an error that is read from the library, in bytes; known details
/// have about 200.
const DETAIL_BYTES: usize = 1024;

/// Error of a call of `libphidget22`. The text of the error completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {reason}")]
pub struct CallError {
    pub(crate) what: String,
    pub(crate) reason: String,
    code: ReturnCode,
}

impl CallError {
    /// Returns the error for a device that was attached before and is unplugged at present.
    pub(crate) fn unplugged() -> CallError {
        let reason = "it was unplugged".to_owned();
        CallError { what: "find it".to_owned(), reason, code: NOT_ATTACHED }
    }

    /// Whether the error is that no device attached in time. A device may still attach later.
    pub(crate) fn is_timeout(&self) -> bool {
        self.code == TIMEOUT
    }
}

/// Class of a channel, which determines the functions of the library that work on the channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ChannelClass {
    /// Device that measures the temperature by itself, without an input of an interface kit.
    Temperature,
    Humidity,
    Light,
    /// Analog input of an interface kit, read as the ratio of its voltage to the supply voltage.
    Ratio,
    /// Analog input of an interface kit, read as its voltage in volts.
    Voltage,
    Digital,
}

/// Functions of the library that create and read a channel of one class.
struct ClassFunctions {
    create: CreateFn,
    read: ReadFunctions,
}

enum ReadFunctions {
    Double(GetDoubleFn),
    Int(GetIntFn),
    /// Functions for an analog input: they read and set the type of the attached sensor, and read
    /// the value for that type.
    Sensor {
        sensor_type: GetIntFn,
        set_sensor_type: SetIntFn,
        value: GetDoubleFn,
    },
}

/// Functions of `libphidget22` that this crate calls.
///
/// The library is never unloaded, so that the functions are valid until the process ends.
pub(crate) struct LibraryFunctions {
    version: unsafe extern "C" fn(*mut *const c_char) -> ReturnCode,
    describe: unsafe extern "C" fn(ReturnCode, *mut *const c_char) -> ReturnCode,
    last_error: unsafe extern "C" fn(
        *mut ReturnCode,
        *mut *const c_char,
        *mut c_char,
        *mut usize,
    ) -> ReturnCode,
    set_serial: SetIntFn,
    set_hub_port: SetIntFn,
    set_is_hub_port: SetIntFn,
    set_channel: SetIntFn,
    open: ChannelFn,
    open_waiting: unsafe extern "C" fn(RawChannel, u32) -> ReturnCode,
    attached: GetIntFn,
    close: ChannelFn,
    delete: CreateFn,
    temperature: ClassFunctions,
    humidity: ClassFunctions,
    light: ClassFunctions,
    ratio: ClassFunctions,
    voltage: ClassFunctions,
    digital: ClassFunctions,
}

impl LibraryFunctions {
    /// Loads the library from a file; the library is never unloaded.
    pub(crate) fn load(file: &OsStr) -> Result<&'static LibraryFunctions, String> {
        // SAFETY: no caller can prove the behaviour of a library while it is loaded. The owner of
        // this machine has installed or named this file, as with a program that is run.
        // `libphidget22` itself has only ordinary constructors.
        let library =
            unsafe { libloading::Library::new(file) }.map_err(|error| linker_message(&error))?;
        let functions = LibraryFunctions::of(&library).map_err(|error| linker_message(&error));
        // The wrong library is kept as well: it may have started threads, which need its code.
        std::mem::forget(library);
        let functions = functions?;
        Ok(Box::leak(Box::new(functions)))
    }

    fn of(library: &libloading::Library) -> Result<LibraryFunctions, libloading::Error> {
        // SAFETY: each function has the type that `phidget22.h` declares for its name, which is the
        // type of the field that it is assigned to. The declarations are the same in all versions
        // with a library name that ends in 22.
        unsafe {
            Ok(LibraryFunctions {
                version: function(library, "Phidget_getLibraryVersion")?,
                describe: function(library, "Phidget_getErrorDescription")?,
                last_error: function(library, "Phidget_getLastError")?,
                set_serial: function(library, "Phidget_setDeviceSerialNumber")?,
                set_hub_port: function(library, "Phidget_setHubPort")?,
                set_is_hub_port: function(library, "Phidget_setIsHubPortDevice")?,
                set_channel: function(library, "Phidget_setChannel")?,
                open: function(library, "Phidget_open")?,
                open_waiting: function(library, "Phidget_openWaitForAttachment")?,
                attached: function(library, "Phidget_getAttached")?,
                close: function(library, "Phidget_close")?,
                delete: function(library, "Phidget_delete")?,
                temperature: ClassFunctions {
                    create: function(library, "PhidgetTemperatureSensor_create")?,
                    read: ReadFunctions::Double(function(
                        library,
                        "PhidgetTemperatureSensor_getTemperature",
                    )?),
                },
                humidity: ClassFunctions {
                    create: function(library, "PhidgetHumiditySensor_create")?,
                    read: ReadFunctions::Double(function(
                        library,
                        "PhidgetHumiditySensor_getHumidity",
                    )?),
                },
                light: ClassFunctions {
                    create: function(library, "PhidgetLightSensor_create")?,
                    read: ReadFunctions::Double(function(
                        library,
                        "PhidgetLightSensor_getIlluminance",
                    )?),
                },
                ratio: ClassFunctions {
                    create: function(library, "PhidgetVoltageRatioInput_create")?,
                    read: ReadFunctions::Sensor {
                        sensor_type: function(library, "PhidgetVoltageRatioInput_getSensorType")?,
                        set_sensor_type: function(
                            library,
                            "PhidgetVoltageRatioInput_setSensorType",
                        )?,
                        value: function(library, "PhidgetVoltageRatioInput_getSensorValue")?,
                    },
                },
                voltage: ClassFunctions {
                    create: function(library, "PhidgetVoltageInput_create")?,
                    read: ReadFunctions::Sensor {
                        sensor_type: function(library, "PhidgetVoltageInput_getSensorType")?,
                        set_sensor_type: function(library, "PhidgetVoltageInput_setSensorType")?,
                        value: function(library, "PhidgetVoltageInput_getSensorValue")?,
                    },
                },
                digital: ClassFunctions {
                    create: function(library, "PhidgetDigitalInput_create")?,
                    read: ReadFunctions::Int(function(library, "PhidgetDigitalInput_getState")?),
                },
            })
        }
    }

    fn class(&self, class: ChannelClass) -> &ClassFunctions {
        match class {
            ChannelClass::Temperature => &self.temperature,
            ChannelClass::Humidity => &self.humidity,
            ChannelClass::Light => &self.light,
            ChannelClass::Ratio => &self.ratio,
            ChannelClass::Voltage => &self.voltage,
            ChannelClass::Digital => &self.digital,
        }
    }

    pub(crate) fn version(&self) -> Result<String, CallError> {
        let mut version = ptr::null();
        // SAFETY: the function exists; it writes one pointer to a variable of that type.
        let code = unsafe { (self.version)(&raw mut version) };
        self.check(code, "ask libphidget22 for its version")?;
        // SAFETY: the pointer is to a constant of the library.
        Ok(unsafe { text(version) })
    }

    fn check(&self, code: ReturnCode, what: &str) -> Result<(), CallError> {
        match code {
            0 => Ok(()),
            code => {
                let reason = self.reason(code);
                Err(CallError { what: what.to_owned(), reason, code })
            }
        }
    }

    /// Returns the description of an error code of the library.
    fn reason(&self, code: ReturnCode) -> String {
        let mut description = ptr::null();
        // SAFETY: the function exists and accepts any number; it writes one pointer to a variable
        // of that type.
        let known = unsafe { (self.describe)(code, &raw mut description) };
        // SAFETY: the pointer is to a constant of the library, or still null.
        match unsafe { text(description) } {
            description if known == 0 && !description.is_empty() => description,
            _ => format!("error {code}"),
        }
    }

    /// Returns the detail of this thread's last error in the library; `None` if that error had a
    /// code other than `code`.
    fn detail(&self, code: ReturnCode) -> Option<String> {
        let (mut last, mut description) = (0, ptr::null());
        let mut detail = [0_u8; DETAIL_BYTES];
        // The library may fill all of `room` without a final zero, so the array has one byte more.
        let mut room = DETAIL_BYTES - 1;
        let start = detail.as_mut_ptr().cast();
        // SAFETY: the function exists; each pointer is to a variable of its type, and `detail` has
        // room for the given number of bytes.
        let told =
            unsafe { (self.last_error)(&raw mut last, &raw mut description, start, &raw mut room) };
        let detail = CStr::from_bytes_until_nul(&detail).ok()?.to_string_lossy();
        let words: Vec<_> = detail.split_whitespace().collect();
        (told == 0 && last == code && !words.is_empty()).then(|| words.join(" "))
    }
}

/// Returns the function of the library with this name.
///
/// # Safety
///
/// `F` must be the type of the function with this name in the library.
unsafe fn function<F: Copy>(
    library: &libloading::Library,
    name: &str,
) -> Result<F, libloading::Error> {
    // SAFETY: the caller guarantees the type.
    unsafe { library.get::<F>(name.as_bytes()) }.map(|symbol| *symbol)
}

/// Copies a text that the library owns; returns an empty text if the pointer is null.
///
/// # Safety
///
/// The pointer must be null, or point to a text that ends with a zero byte and is not freed during
/// the call.
unsafe fn text(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: the pointer is not null, and the caller guarantees the rest.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}

/// Returns the message of the dynamic linker, which is the cause of an error of the crate
/// `libloading`.
fn linker_message(error: &libloading::Error) -> String {
    let cause = std::error::Error::source(error);
    cause.map_or_else(|| error.to_string(), ToString::to_string)
}

/// Channel of `libphidget22`. The library's channel exists until this value is dropped.
pub(crate) struct ChannelHandle {
    functions: &'static LibraryFunctions,
    class: ChannelClass,
    raw: NonNull<c_void>,
}

// SAFETY: a channel belongs to no thread: the library locks its own objects, and uses them from
// threads of its own. Only one thread uses a `ChannelHandle` at a time, because it is not `Sync`.
unsafe impl Send for ChannelHandle {}

// Each call below is sound for these reasons: `raw` is a channel made by `create` of its class, and
// only `drop` deletes it; the function is one of this library, which is never unloaded; and the
// function writes to a variable of the right type. If the function is for another class of
// channels, the library refuses the call (`EPHIDGET_WRONGDEVICE`).
impl ChannelHandle {
    pub(crate) fn create(
        functions: &'static LibraryFunctions,
        class: ChannelClass,
    ) -> Result<ChannelHandle, CallError> {
        const WHAT: &str = "make a channel of libphidget22";
        let mut raw = ptr::null_mut();
        // SAFETY: the function exists; it writes one pointer to a variable of that type.
        let code = unsafe { (functions.class(class).create)(&raw mut raw) };
        functions.check(code, WHAT)?;
        let nothing = || CallError { what: WHAT.to_owned(), reason: "there is none".into(), code };
        let raw = NonNull::new(raw).ok_or_else(nothing)?;
        Ok(ChannelHandle { functions, class, raw })
    }

    fn set(&self, set: SetIntFn, value: c_int, what: &str) -> Result<(), CallError> {
        // SAFETY: see above this `impl`.
        let code = unsafe { set(self.raw.as_ptr(), value) };
        self.functions.check(code, what)
    }

    fn int(&self, get: GetIntFn, what: &str) -> Result<c_int, CallError> {
        let mut value = 0;
        // SAFETY: see above this `impl`.
        let code = unsafe { get(self.raw.as_ptr(), &raw mut value) };
        self.functions.check(code, what).map(|()| value)
    }

    fn double(&self, get: GetDoubleFn, what: &str) -> Result<c_double, CallError> {
        let mut value = 0.0;
        // SAFETY: see above this `impl`.
        let code = unsafe { get(self.raw.as_ptr(), &raw mut value) };
        self.functions.check(code, what).map(|()| value)
    }

    pub(crate) fn set_serial(&self, serial: i32) -> Result<(), CallError> {
        self.set(self.functions.set_serial, serial, "choose a Phidget by its serial number")
    }

    pub(crate) fn set_hub_port(&self, port: i32) -> Result<(), CallError> {
        self.set(self.functions.set_hub_port, port, "choose a port of a hub")
    }

    /// Makes the channel use the hub's port itself as the input, for a port without a Phidget.
    pub(crate) fn set_is_hub_port(&self) -> Result<(), CallError> {
        self.set(self.functions.set_is_hub_port, 1, "use a port of a hub as an input")
    }

    pub(crate) fn set_channel(&self, channel: i32) -> Result<(), CallError> {
        self.set(self.functions.set_channel, channel, "choose a port")
    }

    /// Opens the channel and waits for the channel's device. If the device does not attach in time,
    /// the channel is closed again.
    pub(crate) fn open_waiting(&self, wait: Duration) -> Result<(), CallError> {
        // 0 would mean to wait without limit.
        let wait = u32::try_from(wait.as_millis()).unwrap_or(u32::MAX).max(1);
        // SAFETY: see above this `impl`.
        let code = unsafe { (self.functions.open_waiting)(self.raw.as_ptr(), wait) };
        let opened = self.functions.check(code, "find it");
        // The detail is read on the same thread and before any other call, so that it is about this
        // call.
        opened.map_err(|mut error| {
            if let Some(detail) = self.functions.detail(code) {
                error.reason = format!("{}: {detail}", error.reason);
            }
            error
        })
    }

    /// Opens the channel. The channel's device may attach at any later time.
    pub(crate) fn open(&self) -> Result<(), CallError> {
        // SAFETY: see above this `impl`.
        let code = unsafe { (self.functions.open)(self.raw.as_ptr()) };
        self.functions.check(code, "open it")
    }

    /// Whether the channel's device is attached. A failed call counts as not attached.
    pub(crate) fn is_attached(&self) -> bool {
        self.int(self.functions.attached, "look for it").is_ok_and(|attached| attached != 0)
    }

    /// Returns the value of the channel. For an analog input, this is the value for the sensor type
    /// `wanted_type`.
    pub(crate) fn read(&self, wanted_type: i32) -> Result<f64, CallError> {
        match self.functions.class(self.class).read {
            ReadFunctions::Double(get) => self.double(get, "read it"),
            ReadFunctions::Int(get) => self.int(get, "read it").map(f64::from),
            ReadFunctions::Sensor { sensor_type, set_sensor_type, value } => {
                // A device that was unplugged has lost its sensor type.
                if self.int(sensor_type, "read it")? != wanted_type {
                    self.set(set_sensor_type, wanted_type, "set the type of the sensor")?;
                }
                self.double(value, "read it")
            }
        }
    }
}

impl Drop for ChannelHandle {
    fn drop(&mut self) {
        let mut raw = self.raw.as_ptr();
        // SAFETY: see above this `impl`; nothing uses the channel after this. A channel that was
        // not opened may be closed: the library only reports that it is not open.
        unsafe {
            (self.functions.close)(raw);
            (self.functions.delete)(&raw mut raw);
        }
    }
}
