//! From a frame of the link to the payload of a UDP datagram.

use etherparse::defrag::IpDefragPool;
use etherparse::{EtherType, NetSlice, SlicedPacket, TransportSlice, UdpSlice};
use pcap_parser::Linktype;
use std::fmt;
use std::net::{IpAddr, SocketAddr};

/// Packets after which the fragments of a datagram that never became whole are forgotten: a second of a fast lidar.
const FRAGMENTS_KEPT: u64 = 4_096;

/// A loopback header of BSD, an address family of four bytes.
const NULL_BYTES: usize = 4;
/// LINUX_SLL2: the protocol, then the interface and its address.
const SLL2_BYTES: usize = 20;
const LINKTYPE_LINUX_SLL2: Linktype = Linktype(276);
/// BSD's numbers for raw IP.
const LINKTYPE_RAW_BSD: [Linktype; 2] = [Linktype(12), Linktype(14)];

/// From where a datagram came and where it went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UdpAddress {
    /// From where.
    pub source: SocketAddr,
    /// To where.
    pub destination: SocketAddr,
}

/// What was passed over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    /// Packets that are no UDP.
    pub other: u64,
    /// Packets whose headers contradict their length.
    pub malformed: u64,
    /// Packets of which only the beginning was recorded.
    pub truncated: u64,
    /// Packets of interfaces whose link type carries no IP that is known here.
    pub of_other_links: u64,
    /// The file ends within a packet.
    pub ends_early: bool,
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} no UDP", self.other + self.malformed)?;
        if self.of_other_links > 0 {
            write!(f, ", {} of links without IP", self.of_other_links)?;
        }
        if self.truncated > 0 {
            write!(
                f,
                ", {} recorded in part only (a snap length: tcpdump -s 0)",
                self.truncated
            )?;
        }
        if self.ends_early {
            write!(f, ", the file ends within a packet")?;
        }
        Ok(())
    }
}

/// Takes the headers off, and puts fragments together.
#[derive(Debug, Default)]
pub(super) struct Network {
    fragments: IpDefragPool<u64>,
    packets: u64,
    payload: Vec<u8>,
    skipped: Skipped,
}

impl Network {
    /// Whether this link type carries IP that is known here.
    fn knows(link: Linktype) -> bool {
        [
            Linktype::ETHERNET,
            Linktype::NULL,
            Linktype::LOOP,
            Linktype::RAW,
            Linktype::IPV4,
            Linktype::IPV6,
            Linktype::LINUX_SLL,
            LINKTYPE_LINUX_SLL2,
        ]
        .contains(&link)
            || LINKTYPE_RAW_BSD.contains(&link)
    }

    /// Takes one packet, of which `is_truncated` when only the beginning was recorded; where a datagram went, if that completes one.
    /// [`Self::payload`] is then what it carries.
    pub fn packet(&mut self, link: Linktype, data: &[u8], is_truncated: bool) -> Option<UdpAddress> {
        self.packets += 1;
        if !Self::knows(link) {
            self.skipped.of_other_links += 1;
            return None;
        }
        let Some(packet) = sliced(link, data) else {
            match is_truncated {
                true => self.skipped.truncated += 1,
                false => self.skipped.malformed += 1,
            }
            return None;
        };
        let Some(ends) = ends(&packet) else {
            self.skipped.other += 1;
            return None;
        };
        if let Some(TransportSlice::Udp(udp)) = &packet.transport {
            return Some(keep(&mut self.payload, udp, ends));
        }
        if !packet.is_ip_payload_fragmented() {
            self.skipped.other += 1;
            return None;
        }
        let now = self.packets;
        let whole = self.fragments.process_sliced_packet(&packet, now, ());
        if now.is_multiple_of(FRAGMENTS_KEPT) {
            self.fragments.retain(|begun| now - *begun < FRAGMENTS_KEPT);
        }
        match whole {
            Ok(None) => None,
            Ok(Some(whole)) => {
                let address = UdpSlice::from_slice(&whole.payload)
                    .ok()
                    .filter(|_| whole.ip_number == etherparse::ip_number::UDP)
                    .map(|udp| keep(&mut self.payload, &udp, ends));
                self.skipped.other += u64::from(address.is_none());
                self.fragments.return_buf(whole);
                address
            }
            Err(_) => {
                self.skipped.malformed += 1;
                None
            }
        }
    }

    /// What the datagram that was completed last carries.
    pub fn payload(&self) -> &[u8] {
        &self.payload
    }

    pub fn skipped(&self) -> Skipped {
        self.skipped
    }

    pub fn count_malformed(&mut self) {
        self.packets += 1;
        self.skipped.malformed += 1;
    }

    /// The file has ended within a packet.
    pub fn ended_early(&mut self) {
        self.skipped.ends_early = true;
    }

    /// Whether there were packets, and all of them of other links.
    pub fn is_all_of_other_links(&self) -> bool {
        self.packets > 0 && self.skipped.of_other_links == self.packets
    }
}

fn keep(payload: &mut Vec<u8>, udp: &UdpSlice<'_>, [source, destination]: [IpAddr; 2]) -> UdpAddress {
    payload.clear();
    payload.extend_from_slice(udp.payload());
    UdpAddress {
        source: SocketAddr::new(source, udp.source_port()),
        destination: SocketAddr::new(destination, udp.destination_port()),
    }
}

fn sliced(link: Linktype, data: &[u8]) -> Option<SlicedPacket<'_>> {
    match link {
        Linktype::ETHERNET => SlicedPacket::from_ethernet(data).ok(),
        Linktype::LINUX_SLL => SlicedPacket::from_linux_sll(data).ok(),
        Linktype::NULL | Linktype::LOOP => SlicedPacket::from_ip(data.get(NULL_BYTES..)?).ok(),
        LINKTYPE_LINUX_SLL2 => {
            let protocol = u16::from_be_bytes([*data.first()?, *data.get(1)?]);
            SlicedPacket::from_ether_type(EtherType(protocol), data.get(SLL2_BYTES..)?).ok()
        }
        _ => SlicedPacket::from_ip(data).ok(),
    }
}

fn ends(packet: &SlicedPacket<'_>) -> Option<[IpAddr; 2]> {
    match packet.net.as_ref()? {
        NetSlice::Ipv4(ip) => {
            let header = ip.header();
            Some([header.source_addr().into(), header.destination_addr().into()])
        }
        NetSlice::Ipv6(ip) => {
            let header = ip.header();
            Some([header.source_addr().into(), header.destination_addr().into()])
        }
        NetSlice::Arp(_) => None,
    }
}
