//! The decoder of a network lidar, whichever it is.

use crate::decode::{Decode, Fault, Item};
use crate::livox::sdk1::Livox1;
use crate::livox::sdk2::Livox2;
use crate::models::NetworkProtocol;
use crate::ouster::{Metadata, Ouster};
use crate::velodyne::Velodyne;

/// Decodes the packets of one network lidar.
#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one in a process: a box would save nothing"
)]
pub enum Decoder {
    /// Ouster's.
    Ouster(Ouster),
    /// Velodyne's.
    Velodyne(Velodyne),
    /// Livox's second protocol.
    Livox2(Livox2),
    /// Livox's first protocol.
    Livox1(Livox1),
}

impl Decoder {
    /// For a model that needs nothing but its name; `None` for one that needs metadata. `rate_hz`: scans per second of
    /// a model whose pattern has no turns.
    pub fn of(protocol: NetworkProtocol, rate_hz: f64) -> Option<Self> {
        match protocol {
            NetworkProtocol::Ouster => None,
            NetworkProtocol::Velodyne(lasers) => Some(Self::Velodyne(Velodyne::new(lasers))),
            NetworkProtocol::Livox2 => Some(Self::Livox2(Livox2::new(rate_hz))),
            NetworkProtocol::Livox1 => Some(Self::Livox1(Livox1::new(rate_hz))),
        }
    }

    /// For the Ouster sensor that `metadata` describe.
    pub fn ouster(metadata: Metadata) -> Self {
        Self::Ouster(Ouster::new(metadata))
    }

    /// Directions of a scan and returns of each; `None` where they are not known.
    pub fn directions(&self) -> Option<(usize, u8)> {
        match self {
            Self::Ouster(ouster) => {
                let metadata = ouster.metadata();
                Some((metadata.rows * metadata.columns_sent(), metadata.profile.returns))
            }
            Self::Velodyne(_) | Self::Livox1(_) | Self::Livox2(_) => None,
        }
    }
}

impl Decode for Decoder {
    fn packet(&mut self, bytes: &[u8], sink: &mut dyn FnMut(Item)) -> Result<(), Fault> {
        match self {
            Self::Ouster(decoder) => decoder.packet(bytes, sink),
            Self::Velodyne(decoder) => decoder.packet(bytes, sink),
            Self::Livox2(decoder) => decoder.packet(bytes, sink),
            Self::Livox1(decoder) => decoder.packet(bytes, sink),
        }
    }

    fn restart(&mut self) {
        match self {
            Self::Ouster(decoder) => decoder.restart(),
            Self::Velodyne(decoder) => decoder.restart(),
            Self::Livox2(decoder) => decoder.restart(),
            Self::Livox1(decoder) => decoder.restart(),
        }
    }

    fn finish(&mut self, sink: &mut dyn FnMut(Item)) {
        match self {
            Self::Ouster(decoder) => decoder.finish(sink),
            Self::Velodyne(decoder) => decoder.finish(sink),
            Self::Livox2(decoder) => decoder.finish(sink),
            Self::Livox1(decoder) => decoder.finish(sink),
        }
    }
}
