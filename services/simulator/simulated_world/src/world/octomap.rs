//! Reads OctoMap's binary files (`.bt`): which cells are occupied.
//!
//! After a header of text lines (`id OcTree`, `size N`, `res R`, `data`) come the inner nodes in depth-first order, two bytes each: two bits
//! per child, from the lowest, 0 unknown, 1 free, 2 occupied, 3 an inner node that follows. Source: OctoMap's
//! `OcTree::readBinaryNode`, and A. Hornung et al., "OctoMap", Autonomous Robots 2013.

use super::spec::WorldError;

/// Levels below the root.
const DEPTH: u32 = 16;
/// What every file begins with.
const MAGIC: &str = "# Octomap OcTree binary file";
/// More cells than this (finest ones) are no world for a vehicle, but a mistake or an attack.
const CELLS_MAX: usize = 20_000_000;

/// Occupied cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Octomap {
    /// Edge of the finest cell (m).
    pub cell_m: f64,
    /// Finest cells that are occupied, by index; x, y, z of the file, z up. Cell `i` reaches from `i * cell_m` to `(i + 1) * cell_m`.
    pub occupied: Vec<[i32; 3]>,
}

impl Octomap {
    /// Reads the bytes of a file; `name` appears in errors.
    ///
    /// # Errors
    /// [`WorldError::File`] saying what is wrong.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Self, WorldError> {
        let wrong = |message: &str| WorldError::File {
            file: name.to_owned(),
            message: message.to_owned(),
        };
        let (header, data) = split(bytes).ok_or_else(|| wrong("there is no line \"data\" in it"))?;
        if !header.starts_with(MAGIC) {
            return Err(wrong(
                "it is no binary OctoMap: it does not begin with \"# Octomap OcTree binary file\"",
            ));
        }
        let value = |key: &str| {
            header
                .lines()
                .find_map(|line| line.strip_prefix(key))
                .map(str::trim)
        };
        if value("id ") != Some("OcTree") {
            return Err(wrong("its id is not OcTree"));
        }
        let cell_m = value("res ").and_then(|text| text.parse::<f64>().ok());
        let cell_m = cell_m.filter(|cell_m| (1e-3..=10.0).contains(cell_m));
        let cell_m = cell_m.ok_or_else(|| wrong("its res is no number from 0.001 to 10"))?;
        let mut tree = Tree {
            data,
            occupied: Vec::new(),
        };
        let half = 1 << (DEPTH - 1);
        tree.read(1, [-half; 3]).map_err(wrong)?;
        if !tree.data.is_empty() {
            return Err(wrong("there is more in it than its tree"));
        }
        Ok(Self {
            cell_m,
            occupied: tree.occupied,
        })
    }
}

/// Header and data.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    const END: &[u8] = b"\ndata\n";
    let end = bytes.windows(END.len()).position(|window| window == END)?;
    Some((
        std::str::from_utf8(&bytes[..end]).ok()?,
        &bytes[end + END.len()..],
    ))
}

struct Tree<'a> {
    data: &'a [u8],
    occupied: Vec<[i32; 3]>,
}

impl Tree<'_> {
    /// Reads an inner node whose children lie at `depth`, and all below; `low` is its lowest cell.
    fn read(&mut self, depth: u32, low: [i32; 3]) -> Result<(), &'static str> {
        let Some(([first, second], rest)) = self.data.split_first_chunk::<2>() else {
            return Err("it ends in the middle of its tree");
        };
        let bits = u16::from_le_bytes([*first, *second]);
        self.data = rest;
        if depth > DEPTH {
            return Err("its tree is deeper than 16 levels");
        }
        let size = 1 << (DEPTH - depth);
        for child in 0..8 {
            let corner =
                std::array::from_fn(|axis| low[axis] + if child >> axis & 1 == 1 { size } else { 0 });
            match bits >> (2 * child) & 3 {
                2 => self.fill(corner, size)?,
                3 => self.read(depth + 1, corner)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn fill(&mut self, low: [i32; 3], size: i32) -> Result<(), &'static str> {
        let cells = (size as usize).saturating_pow(3);
        if cells.saturating_add(self.occupied.len()) > CELLS_MAX {
            return Err("more of it is occupied than a world may be");
        }
        for x in low[0]..low[0] + size {
            for y in low[1]..low[1] + size {
                self.occupied.extend((low[2]..low[2] + size).map(|z| [x, y, z]));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::Octomap;
    use proptest::prelude::*;

    fn file(tree: &[u8]) -> Vec<u8> {
        let mut bytes = b"# Octomap OcTree binary file\n# more\nid OcTree\nsize 9\nres 0.5\ndata\n".to_vec();
        bytes.extend(tree);
        bytes
    }

    /// A chain of inner nodes down to the cells around the origin (child 7 of the root, then always child 0), whose last node says `bits`.
    fn chain(bits: u16) -> Vec<u8> {
        let mut tree = (3_u16 << 14).to_le_bytes().to_vec();
        for _ in 0..14 {
            tree.extend(3_u16.to_le_bytes());
        }
        tree.extend(bits.to_le_bytes());
        tree
    }

    #[test]
    fn cells_lie_where_octomap_has_them() {
        let map = Octomap::parse("x.bt", &file(&chain(0b10_01_10))).unwrap();
        assert_eq!((map.cell_m, map.occupied), (0.5, vec![[0, 0, 0], [0, 1, 0]]));
    }

    #[test]
    fn what_is_no_map_is_refused_with_its_name() {
        let whole = file(&chain(2));
        let cases: [(&[u8], &str); 4] = [
            (b"# something\ndata\n", "no binary OctoMap"),
            (b"no line", "no line \"data\""),
            (&whole[..whole.len() - 1], "ends in the middle"),
            (&file(&[chain(2), vec![0]].concat()), "more in it"),
        ];
        for (bytes, words) in cases {
            let error = Octomap::parse("x.bt", bytes).unwrap_err().to_string();
            assert!(error.starts_with("x.bt: ") && error.contains(words), "{error}");
        }
        // Everything occupied: a few bytes that would be 2^48 cells.
        assert!(Octomap::parse("x.bt", &file(&0xaaaa_u16.to_le_bytes())).is_err());
    }

    proptest! {
        #[test]
        fn garbage_is_refused_and_never_fatal(tree in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _refused_or_not = Octomap::parse("x.bt", &file(&tree));
        }
    }

    #[test]
    fn the_building_is_read_to_its_end() {
        let map = Octomap::parse("building", super::super::structure::BUILDING).unwrap();
        assert_eq!((map.cell_m, map.occupied.len()), (0.08, 185_673));
    }
}
