//! Recorded packets: UDP datagrams out of a pcap or pcapng file, with the time at which they were recorded.
//!
//! The file formats are read by pcap-parser, the headers between the link and UDP, and fragments of IP packets, by
//! etherparse. A file that was cut off ends where it is cut; whatever is no whole UDP datagram is counted and passed
//! over, and so are the packets of interfaces that carry no IP.

mod network;

use network::Network;
pub use network::{Skipped, UdpAddress};
use pcap_parser::traits::PcapReaderIterator;
use pcap_parser::{Block, Linktype, PcapBlockOwned, PcapError, create_reader};
use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Room for one block of a file (bytes): the longest packet of a loopback interface, many times.
const BUFFER_BYTES: usize = 1 << 20;

/// Why a recording cannot be read.
#[derive(Debug)]
pub enum CaptureError {
    /// The file cannot be opened.
    Open {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// It is no pcap or pcapng file.
    NotACapture {
        /// Its path.
        path: PathBuf,
    },
    /// All its packets are of links that carry no IP that is known here.
    LinkType {
        /// Its path.
        path: PathBuf,
        /// The number of the link type (LINKTYPE_...).
        number: i32,
    },
    /// The file is damaged.
    Damaged {
        /// Its path.
        path: PathBuf,
        /// Bytes before the damage.
        at: u64,
        /// What is wrong.
        cause: String,
    },
}

impl fmt::Display for CaptureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open { path, source } => write!(f, "{}: cannot be opened: {source}", path.display()),
            Self::NotACapture { path } => {
                write!(f, "{}: neither a pcap nor a pcapng file", path.display())
            }
            Self::LinkType { path, number } => write!(
                f,
                "{}: link type {number} is not supported; record on an Ethernet interface, or on \"any\"",
                path.display()
            ),
            Self::Damaged { path, at, cause } => {
                write!(f, "{}: damaged after {at} bytes: {cause}", path.display())
            }
        }
    }
}
impl std::error::Error for CaptureError {}

/// One datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagram<'a> {
    /// When it was recorded (ns since 1970): of fragments, the last.
    pub time_ns: u64,
    /// From where it came and where it went.
    pub address: UdpAddress,
    /// What it carries.
    pub payload: &'a [u8],
}

/// How an interface of the file counts time and what it carries.
#[derive(Clone, Copy, Debug)]
struct Interface {
    link: Linktype,
    /// Units of its time per second.
    per_second: u64,
    /// Seconds that are added to its time.
    offset_s: i64,
}

/// A recording that is read from its beginning to its end.
pub struct Capture {
    path: PathBuf,
    bytes: u64,
    consumed: u64,
    reader: Box<dyn PcapReaderIterator + Send>,
    interfaces: Vec<Interface>,
    network: Network,
}

impl fmt::Debug for Capture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Capture({}, {} of {} bytes)",
            self.path.display(),
            self.consumed,
            self.bytes
        )
    }
}

/// What a block of the file was.
enum ReadStep {
    /// A packet, whose datagram, if it completed one, lies in the network part.
    Packet(Option<(u64, UdpAddress)>),
    Nothing,
    End,
}

impl Capture {
    /// Opens the file at `path`.
    ///
    /// # Errors
    /// [`CaptureError`] naming it.
    pub fn open(path: &Path) -> Result<Self, CaptureError> {
        let cannot = |source| CaptureError::Open {
            path: path.to_owned(),
            source,
        };
        let file = File::open(path).map_err(cannot)?;
        let bytes = file.metadata().map_err(cannot)?.len();
        let reader = create_reader(BUFFER_BYTES, file).map_err(|_| CaptureError::NotACapture {
            path: path.to_owned(),
        })?;
        Ok(Self {
            path: path.to_owned(),
            bytes,
            consumed: 0,
            reader,
            interfaces: Vec::new(),
            network: Network::default(),
        })
    }

    /// The next datagram; `None` at the end of the file.
    ///
    /// # Errors
    /// [`CaptureError`] if the file is damaged, or at its end, if no packet was of a link that carries IP.
    pub fn next_datagram(&mut self) -> Result<Option<Datagram<'_>>, CaptureError> {
        loop {
            match self.step()? {
                ReadStep::Packet(Some((time_ns, address))) => {
                    return Ok(Some(Datagram {
                        time_ns,
                        address,
                        payload: self.network.payload(),
                    }));
                }
                ReadStep::Packet(None) | ReadStep::Nothing => {}
                ReadStep::End => return Ok(None),
            }
        }
    }

    /// Share of the file that has been read, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.consumed as f64 / self.bytes.max(1) as f64
    }

    /// What was passed over so far.
    pub fn skipped(&self) -> Skipped {
        self.network.skipped()
    }

    fn step(&mut self) -> Result<ReadStep, CaptureError> {
        let Self {
            path,
            reader,
            interfaces,
            network,
            consumed,
            ..
        } = self;
        let incomplete = match reader.next() {
            Ok((length, block)) => {
                let step = take(&block, interfaces, network);
                drop(block);
                reader.consume(length);
                *consumed += length as u64;
                return Ok(step);
            }
            Err(PcapError::Eof) => return self.end(),
            Err(PcapError::Incomplete(_)) => true,
            // The file ends within a block: what is whole has been read.
            Err(PcapError::UnexpectedEof) => {
                network.ended_early();
                return self.end();
            }
            Err(error) => {
                let (path, cause) = (path.clone(), explain(&error));
                return Err(CaptureError::Damaged {
                    path,
                    at: *consumed,
                    cause,
                });
            }
        };
        if incomplete && reader.reader_exhausted() {
            network.ended_early();
            return self.end();
        }
        let refilled = reader.refill().map_err(|error| explain(&error));
        refilled
            .map(|()| ReadStep::Nothing)
            .map_err(|cause| CaptureError::Damaged {
                path: path.clone(),
                at: *consumed,
                cause,
            })
    }
}

impl Capture {
    fn end(&self) -> Result<ReadStep, CaptureError> {
        match self.interfaces.first() {
            Some(interface) if self.network.is_all_of_other_links() => Err(CaptureError::LinkType {
                path: self.path.clone(),
                number: interface.link.0,
            }),
            _ => Ok(ReadStep::End),
        }
    }
}

fn explain(error: &PcapError<&[u8]>) -> String {
    match error {
        PcapError::BufferTooSmall => format!("a block of more than {BUFFER_BYTES} bytes"),
        PcapError::ReadError => "a read failed".to_owned(),
        PcapError::NomError(_, kind) | PcapError::OwnedNomError(_, kind) => {
            format!("no block begins here ({kind:?})")
        }
        other => format!("{other:?}"),
    }
}

fn take(block: &PcapBlockOwned<'_>, interfaces: &mut Vec<Interface>, network: &mut Network) -> ReadStep {
    let packet =
        |interface: Option<&Interface>, units: u64, data: &[u8], sent: u32, network: &mut Network| {
            let Some(interface) = interface else {
                network.count_malformed();
                return ReadStep::Packet(None);
            };
            let time_ns = nanoseconds(units, interface);
            let address = network.packet(interface.link, data, data.len() < sent as usize);
            ReadStep::Packet(address.map(|address| (time_ns, address)))
        };
    match block {
        PcapBlockOwned::LegacyHeader(header) => {
            interfaces.clear();
            interfaces.push(Interface {
                link: header.network,
                per_second: if header.is_nanosecond_precision() {
                    1_000_000_000
                } else {
                    1_000_000
                },
                offset_s: 0,
            });
            ReadStep::Nothing
        }
        PcapBlockOwned::Legacy(block) => {
            let interface = interfaces.first();
            let per_second = interface.map_or(1, |interface| interface.per_second);
            let units = u64::from(block.ts_sec) * per_second + u64::from(block.ts_usec);
            packet(interface, units, block.data, block.origlen, network)
        }
        PcapBlockOwned::NG(Block::SectionHeader(_)) => {
            interfaces.clear();
            ReadStep::Nothing
        }
        PcapBlockOwned::NG(Block::InterfaceDescription(description)) => {
            interfaces.push(Interface {
                link: description.linktype,
                per_second: description.ts_resolution().unwrap_or(1_000_000).max(1),
                offset_s: description.ts_offset(),
            });
            ReadStep::Nothing
        }
        PcapBlockOwned::NG(Block::EnhancedPacket(block)) => {
            let units = u64::from(block.ts_high) << 32 | u64::from(block.ts_low);
            let length = (block.caplen as usize).min(block.data.len());
            packet(
                interfaces.get(block.if_id as usize),
                units,
                &block.data[..length],
                block.origlen,
                network,
            )
        }
        PcapBlockOwned::NG(Block::SimplePacket(block)) => {
            let length = (block.origlen as usize).min(block.data.len());
            packet(
                interfaces.first(),
                0,
                &block.data[..length],
                block.origlen,
                network,
            )
        }
        PcapBlockOwned::NG(_) => ReadStep::Nothing,
    }
}

/// A time of an interface in nanoseconds since 1970; what lies outside 64 bits is cut.
fn nanoseconds(units: u64, interface: &Interface) -> u64 {
    let since = i128::from(units) * 1_000_000_000 / i128::from(interface.per_second);
    let ns = since + i128::from(interface.offset_s) * 1_000_000_000;
    ns.clamp(0, i128::from(u64::MAX)) as u64
}
