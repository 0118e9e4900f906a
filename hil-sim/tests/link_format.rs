//! The link's frames are those of docs/link.md, and change only with their version.

use model_core::device::Command;
use model_core::io::{Output, Request, Sensors};
use model_core::link::{
    Crash, FRAME_LEN_MAX, FromDevice, ResetCause, SettingsSource, Source, Telemetry, ToDevice,
    VERSION, Written, encode,
};
use model_core::plausibility::Doubt;
use model_core::pressure::GaugePa;
use model_core::signal::{AdcCount, EncoderCount};
use model_core::start::StartFault;
use model_core::supervisor::{Fault, Mode};
use model_core::timing::Timing;
use serde::Serialize;
use serde_reflection::{Samples, Tracer, TracerConfig};

/// `message` as docs/link.md writes its frames.
fn frame(message: &impl Serialize) -> String {
    let mut buffer = [0; FRAME_LEN_MAX];
    let frame = encode(message, &mut buffer).unwrap();
    let bytes: Vec<String> = frame.iter().map(|byte| format!("{byte:02X}")).collect();
    bytes.join(" ")
}

#[test]
fn frames_match_the_specification() {
    let specification = include_str!("../../docs/link.md");
    assert!(specification.contains(&format!("Version {VERSION}.")));
    let telemetry = Telemetry {
        tick: 300,
        source: Source::Link(7),
        sensors: Sensors {
            bridge: AdcCount(2049),
            pressure: AdcCount(411),
            encoder: EncoderCount(u32::MAX),
            read_back: AdcCount(3),
            missed_ticks: 0,
            request: Request::None,
        },
        output: Output {
            mode: Mode::Venting,
            fault: Some(Fault::Uncommanded),
            pressure_ref: GaugePa(0.0),
            finger_force_n: 0.5,
            reference_force_n: 10.0,
            contraction: 0.125,
            pressure: GaugePa(1000.0),
            ..Output::default()
        },
        timing: Timing {
            missed_ticks: 0,
            late_cycles: 100,
            busy_cycles: 900,
            missed_ticks_total: 2,
            late_cycles_max: 120,
            busy_cycles_max: 1_000,
            link_per_mille: 70,
        },
    };
    let frames = [
        frame(&ToDevice::Identify),
        frame(&ToDevice::Command(Command::Request(Request::Vent))),
        frame(&FromDevice::Telemetry(telemetry)),
    ];
    for frame in frames {
        assert!(specification.contains(&format!("`{frame}`")), "{frame}");
    }
}

/// Every message with all variants and fields. A reader of another version would misinterpret a
/// changed message, or drop it silently.
#[test]
fn messages_of_a_version_never_change() {
    let mut tracer = Tracer::new(TracerConfig::default());
    let samples = Samples::new();
    // A missing message is an error below.
    tracer.trace_type::<ToDevice>(&samples).unwrap();
    tracer.trace_type::<FromDevice>(&samples).unwrap();
    tracer.trace_simple_type::<Command>().unwrap();
    tracer.trace_simple_type::<Crash>().unwrap();
    tracer.trace_simple_type::<Doubt>().unwrap();
    tracer.trace_simple_type::<Fault>().unwrap();
    tracer.trace_simple_type::<Mode>().unwrap();
    tracer.trace_simple_type::<Request>().unwrap();
    tracer.trace_simple_type::<ResetCause>().unwrap();
    tracer.trace_simple_type::<SettingsSource>().unwrap();
    tracer.trace_simple_type::<StartFault>().unwrap();
    tracer.trace_simple_type::<Source>().unwrap();
    tracer.trace_simple_type::<Written>().unwrap();
    let registry = tracer.registry().unwrap();
    let of_type = |(name, format)| format!("{name} {}\n", serde_json::to_string(format).unwrap());
    let messages: String = registry.iter().map(of_type).collect();
    let path = format!("{}/../docs/link.v{VERSION}.txt", env!("CARGO_MANIFEST_DIR"));
    let known = std::fs::read_to_string(&path).unwrap_or_default();
    if messages != known {
        let new = format!("{}/link.txt", env!("CARGO_TARGET_TMPDIR"));
        std::fs::write(&new, messages).unwrap();
        panic!(
            "the messages have changed. Raise VERSION in model-core/src/link.rs, and in \
             settings.rs if it is the settings; follow in docs/link.md; rename {path}, and copy \
             {new} there"
        );
    }
}
