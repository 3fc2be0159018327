//! `jink lidar dump`: the returns in a recording as a table of text.
//!
//! One line per return, in the order of the packets: `scan,row,column,range_m,x_m,y_m,z_m`, in the sensor frame. Rows
//! are lasers, beams or lines, columns the measurement ids (Ouster), firings of a turn (Velodyne) or points of a line
//! (Livox).

use crate::capture::{Capture, CaptureError, Datagram, Skipped};
use crate::decode::{Decode, Fault, Item};
use crate::decoder::Decoder;
use crate::models::{self, Connection, NetworkProtocol};
use crate::ouster::{Metadata, MetadataError};
use crate::{livox, velodyne};
use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// First line of the table.
pub const HEADER: &str = "scan,row,column,range_m,x_m,y_m,z_m";

/// Progress is reported this often while the file is long.
const PROGRESS: Duration = Duration::from_secs(2);
/// Length of Livox scans (Hz).
const LIVOX_HZ: f64 = 10.0;
/// Exit code of wrong usage, as that of the command.
const WRONG_USAGE: u8 = 2;

/// What to decode.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DumpRequest {
    /// The recording.
    pub pcap: PathBuf,
    /// Metadata of an Ouster sensor.
    pub metadata: Option<PathBuf>,
    /// The model; guessed without.
    pub model: Option<String>,
    /// Where the table goes.
    pub csv: PathBuf,
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Scans, the last of which may be cut off.
    pub scans: u64,
    /// Lines of the table.
    pub returns: u64,
    /// Packets that were decoded.
    pub packets: u64,
    /// Packets missing in the scans.
    pub lost: u64,
    /// Packets that were passed over: foreign, damaged, doubled, late, without ranges.
    pub passed_over: [u64; 5],
    /// Frames of the recording that hold no whole UDP datagram, and why.
    pub skipped: Skipped,
}

/// Why there is no table.
#[derive(Debug)]
pub enum DumpError {
    /// The arguments.
    Usage(String),
    /// The recording.
    Capture(CaptureError),
    /// A file cannot be read or written.
    File {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The metadata are of no use.
    Metadata {
        /// Their path.
        path: PathBuf,
        /// Why.
        source: MetadataError,
    },
    /// An Ouster sensor without metadata.
    NeedsMetadata {
        /// The recording.
        pcap: PathBuf,
    },
    /// No packet of the recording is of the model, or of any.
    NothingDecoded {
        /// The recording.
        pcap: PathBuf,
        /// Datagrams in it.
        datagrams: u64,
        /// Frames that hold none.
        skipped: Skipped,
        /// The model, if one was named or guessed.
        model: Option<String>,
    },
}

impl fmt::Display for DumpError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(text) => f.write_str(text),
            Self::Capture(error) => error.fmt(f),
            Self::File { path, source } => write!(f, "{}: {source}", path.display()),
            Self::Metadata { path, source } => write!(f, "{}: {source}", path.display()),
            Self::NeedsMetadata { pcap } => write!(
                f,
                "{}: an Ouster recording needs its metadata: --metadata FILE (the JSON file beside the recording, or \
                 `curl http://SENSOR/api/v1/sensor/metadata -o FILE`)",
                pcap.display()
            ),
            Self::NothingDecoded {
                pcap,
                datagrams,
                skipped,
                model,
            } => {
                write!(
                    f,
                    "{}: none of {datagrams} datagrams is a packet of ",
                    pcap.display()
                )?;
                match model {
                    Some(model) => write!(
                        f,
                        "a {model}; does the model, or the metadata, belong to this recording?"
                    ),
                    None => f.write_str("a known lidar; name it with --model, an Ouster by --metadata FILE"),
                }?;
                match skipped {
                    Skipped { truncated: 0, .. } => Ok(()),
                    skipped => write!(f, " ({skipped})"),
                }
            }
        }
    }
}
impl std::error::Error for DumpError {}

impl From<CaptureError> for DumpError {
    fn from(error: CaptureError) -> Self {
        Self::Capture(error)
    }
}

/// The tool: writes the table, and reports the result on standard error.
pub fn run(request: &DumpRequest) -> ExitCode {
    match dump(request, &mut report_progress()) {
        Ok(summary) => {
            eprintln!("{summary}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("jink: {error}");
            match error {
                DumpError::Usage(_) => ExitCode::from(WRONG_USAGE),
                _ => ExitCode::FAILURE,
            }
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [foreign, damaged, doubled, late, other] = self.passed_over;
        write!(
            f,
            "{} scans, {} returns of {} packets; {} lost, {foreign} foreign, {damaged} damaged, {doubled} doubled, {late} late, \
             {other} without ranges, {}",
            self.scans, self.returns, self.packets, self.lost, self.skipped
        )
    }
}

/// Writes the table of a recording. `progress` is called with the share that has been read and the scans so far.
///
/// # Errors
/// [`DumpError`].
pub fn dump(request: &DumpRequest, progress: &mut dyn FnMut(f64, u64)) -> Result<Summary, DumpError> {
    let is_new = !request.csv.exists();
    let dumped = write(request, progress);
    if dumped.is_err() && is_new {
        // A table of nothing, or half a one, would be taken for the recording's; there may be none.
        let _none_was_made = std::fs::remove_file(&request.csv);
    }
    dumped
}

fn write(request: &DumpRequest, progress: &mut dyn FnMut(f64, u64)) -> Result<Summary, DumpError> {
    let mut decoder = named(request)?;
    let mut capture = Capture::open(&request.pcap)?;
    let cannot_write = |source| DumpError::File {
        path: request.csv.clone(),
        source,
    };
    let file = File::create(&request.csv).map_err(cannot_write)?;
    let mut table = Table::new(BufWriter::new(file)).map_err(cannot_write)?;
    let mut datagrams = 0u64;
    loop {
        let share = capture.progress();
        let Some(datagram) = capture.next_datagram()? else {
            break;
        };
        datagrams += 1;
        if decoder.is_none() {
            decoder = guess(datagram.payload);
        }
        if let Some(decoder) = &mut decoder {
            table.datagram(decoder, &datagram);
        }
        if datagrams.is_multiple_of(256) {
            progress(share, table.summary.scans);
        }
    }
    if let Some(decoder) = &mut decoder {
        decoder.finish(&mut |item| table.item(item));
    }
    if table.summary.packets == 0 {
        return Err(
            if decoder.is_none()
                && request
                    .model
                    .as_deref()
                    .is_some_and(|model| model.starts_with("ouster"))
            {
                DumpError::NeedsMetadata {
                    pcap: request.pcap.clone(),
                }
            } else {
                DumpError::NothingDecoded {
                    pcap: request.pcap.clone(),
                    datagrams,
                    skipped: capture.skipped(),
                    model: request
                        .model
                        .clone()
                        .or(request.metadata.as_ref().map(|_| "ouster".to_owned())),
                }
            },
        );
    }
    table.summary.skipped = capture.skipped();
    table.end().map_err(cannot_write)
}

/// The decoder that the request names.
fn named(request: &DumpRequest) -> Result<Option<Decoder>, DumpError> {
    let model = request
        .model
        .as_deref()
        .map(|name| models::find(name).ok_or(name))
        .transpose();
    let model = model.map_err(|name| {
        let of_network = models::TABLE.iter().filter(|model| model.kind() == "lidar_3d");
        let names: Vec<&str> = of_network.map(|model| model.name).collect();
        DumpError::Usage(format!(
            "--model {name} is not possible; possible: {}",
            names.join(", ")
        ))
    })?;
    let protocol = match model.map(|model| model.connection) {
        Some(Connection::Serial(_)) => {
            return Err(DumpError::Usage(
                "recordings are of network lidars; this model has a serial port".to_owned(),
            ));
        }
        Some(Connection::Network(protocol)) => Some(protocol),
        None => None,
    };
    match (&request.metadata, protocol) {
        (Some(path), None | Some(NetworkProtocol::Ouster)) => Ok(Some(Decoder::ouster(metadata(path)?))),
        (Some(_), Some(_)) => Err(DumpError::Usage(
            "--metadata is for Ouster sensors only".to_owned(),
        )),
        (None, Some(NetworkProtocol::Ouster)) => Err(DumpError::NeedsMetadata {
            pcap: request.pcap.clone(),
        }),
        (None, Some(protocol)) => Ok(Decoder::of(protocol, LIVOX_HZ)),
        (None, None) => Ok(None),
    }
}

/// Reads a file of metadata.
///
/// # Errors
/// [`DumpError`] naming the file.
pub fn metadata(path: &Path) -> Result<Metadata, DumpError> {
    let path = path.to_owned();
    match std::fs::read_to_string(&path) {
        Err(source) => Err(DumpError::File { path, source }),
        Ok(text) => Metadata::parse(&text).map_err(|source| DumpError::Metadata { path, source }),
    }
}

/// The decoder of whatever sends packets like this one; `None` for Ouster's, which need metadata.
fn guess(payload: &[u8]) -> Option<Decoder> {
    let candidates = [
        NetworkProtocol::Velodyne(&velodyne::VLP16_LASERS),
        NetworkProtocol::Velodyne(&velodyne::HI_RES_LASERS),
        NetworkProtocol::Livox2,
        NetworkProtocol::Livox1,
    ];
    // A short packet could be anything.
    let long = payload.len() > livox::sdk2::HEAD_BYTES;
    let mut decoders = candidates
        .iter()
        .filter_map(|protocol| Decoder::of(*protocol, LIVOX_HZ));
    decoders.find_map(|decoder| {
        let mut trial = decoder.clone();
        (long && trial.packet(payload, &mut |_| {}).is_ok()).then_some(decoder)
    })
}

/// The table while it is written.
struct Table {
    out: BufWriter<File>,
    failed: Option<std::io::Error>,
    summary: Summary,
    /// A scan has begun and not ended.
    open: bool,
    /// Only packets from there count: the sender of the first one that is sound.
    source: Option<IpAddr>,
}

impl Table {
    fn new(mut out: BufWriter<File>) -> Result<Self, std::io::Error> {
        writeln!(out, "{HEADER}")?;
        Ok(Self {
            out,
            failed: None,
            summary: Summary::default(),
            open: false,
            source: None,
        })
    }

    fn datagram(&mut self, decoder: &mut Decoder, datagram: &Datagram<'_>) {
        let source = datagram.address.source.ip();
        if self.source.is_some_and(|known| known != source) {
            self.summary.passed_over[0] += 1;
            return;
        }
        match decoder.packet(datagram.payload, &mut |item| self.item(item)) {
            Ok(()) => {
                self.summary.packets += 1;
                self.source = Some(source);
            }
            Err(fault) => {
                let kind = match fault {
                    Fault::Foreign => 0,
                    Fault::Damaged => 1,
                    Fault::Doubled => 2,
                    Fault::Late => 3,
                    Fault::Other => 4,
                };
                self.summary.passed_over[kind] += 1;
            }
        }
    }

    fn item(&mut self, item: Item) {
        match item {
            Item::ScanEnds { lost } => {
                self.summary.lost += u64::from(lost);
                self.summary.scans += u64::from(std::mem::take(&mut self.open));
            }
            Item::Packet { .. } => self.open = true,
            Item::Ray(ray) if ray.is_return() => {
                let [x, y, z] = ray.at(ray.range_m);
                let scan = self.summary.scans;
                let line = writeln!(
                    self.out,
                    "{scan},{},{},{:.4},{x:.6},{y:.6},{z:.6}",
                    ray.row, ray.column, ray.range_m
                );
                if let Err(error) = line {
                    self.failed.get_or_insert(error);
                }
                self.summary.returns += 1;
            }
            Item::Ray(_) => {}
        }
    }

    fn end(mut self) -> Result<Summary, std::io::Error> {
        self.summary.scans += u64::from(self.open);
        self.out.flush()?;
        self.failed.map_or(Ok(self.summary), Err)
    }
}

/// Progress on standard error, every two seconds.
fn report_progress() -> impl FnMut(f64, u64) {
    let mut last = Instant::now();
    move |share, scans| {
        if last.elapsed() >= PROGRESS {
            last = Instant::now();
            eprintln!("{:3.0} %, {scans} scans", share * 100.0);
        }
    }
}
