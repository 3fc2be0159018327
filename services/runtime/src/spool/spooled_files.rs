//! Files that grow in memory and are wanted on a disk.
//!
//! One with the name `GENERATION-NUMBER.EXTENSION` is new: it gets a file of its own in the folder on the disk, and that one's name.
//! What has been carried is given back to the memory; whoever goes on after a carrier that was killed begins where the file on the disk
//! ends.

use super::append;
use crate::file_series::FileSeries;
use rustix::fs::{FallocateFlags, SeekFrom, fallocate, seek};
use rustix::io::Errno;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The file in the spool that says why nothing is carried.
pub const LOST: &str = "lost";
/// What the files in memory may take together while nobody carries them (bytes): five minutes of a busy link.
pub const MEMORY_BYTES: u64 = 16 << 20;
const BLOCK_BYTES: u64 = 512;
/// The largest page of memory that a board has (bytes).
const PAGE_BYTES_MAX: u64 = 64 << 10;

/// Those of one kind.
#[derive(Debug)]
pub struct SpooledFiles {
    spool: PathBuf,
    folder: PathBuf,
    extension: &'static str,
    max_bytes: u64,
    /// How much of each has been carried (bytes).
    carried: BTreeMap<PathBuf, u64>,
}

impl SpooledFiles {
    /// From `spool` to `folder`, where files with `extension` take no more than `max_bytes` together (0: as much as there is).
    pub fn new(spool: &Path, folder: &Path, extension: &'static str, max_bytes: u64) -> Self {
        Self {
            spool: spool.to_owned(),
            folder: folder.to_owned(),
            extension,
            max_bytes,
            carried: BTreeMap::new(),
        }
    }

    /// Carries what has been written since the last time. Whether it could be is said in the spool, for those who write.
    ///
    /// # Errors
    /// The system's about the folder or the disk.
    pub fn carry(&mut self) -> io::Result<()> {
        let carried = self.carry_all();
        let lost = self.spool.join(LOST);
        match &carried {
            Ok(()) => {
                let _is_not_there = std::fs::remove_file(lost);
            }
            Err(error) => {
                if !lost.exists() {
                    std::fs::write(lost, error.to_string())?;
                }
            }
        }
        carried
    }

    fn carry_all(&mut self) -> io::Result<()> {
        for path in files_of(&self.spool, self.extension) {
            let path = match generation_of(&path) {
                Some(generation) => self.name(&path, generation)?,
                None => path,
            };
            let on_disk = self.folder.join(path.file_name().unwrap_or_default());
            let file = File::options().read(true).write(true).open(&path)?;
            let end = file.metadata()?.len();
            let position = match self.carried.get(&path) {
                Some(position) => *position,
                None => first_data(
                    &file,
                    std::fs::metadata(&on_disk).map_or(end, |there| there.len()),
                )?,
            };
            let position = self.carried.entry(path).or_insert(position);
            // Only whole pages are given back: of the first one the last part is behind what was carried before.
            let begin = *position - *position % PAGE_BYTES_MAX;
            let before = *position;
            append(&file, position, end, &on_disk)?;
            if *position > before {
                let punch = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
                fallocate(&file, punch, begin, *position - begin)?;
            }
        }
        Ok(())
    }

    /// A new file gets its place on the disk, and its name.
    fn name(&self, path: &Path, generation: u32) -> io::Result<PathBuf> {
        let series = FileSeries::new(&self.folder, self.extension, generation, self.max_bytes);
        let (_, on_disk) = series.next()?;
        let named = self.spool.join(on_disk.file_name().unwrap_or_default());
        std::fs::rename(path, &named)?;
        tracing::info!("{}", on_disk.display());
        Ok(named)
    }
}

/// A new file of a writer of this `generation` in `spool`, which is made if it is not there.
///
/// # Errors
/// The system's: memory that is full, a folder that is somebody else's.
pub fn begin(spool: &Path, extension: &str, generation: u32) -> io::Result<(File, PathBuf)> {
    std::fs::create_dir_all(spool)?;
    let mut number = 1;
    loop {
        let path = spool.join(format!("{generation}-{number}.{extension}"));
        match File::options().append(true).create_new(true).open(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            made => return Ok((made?, path)),
        }
    }
}

/// Why what is written into `spool` is lost; `None` while it is carried, or there is memory for it.
pub fn why_lost(spool: &Path, extension: &str) -> Option<String> {
    if let Ok(why) = std::fs::read_to_string(spool.join(LOST)) {
        return Some(why);
    }
    let files = files_of(spool, extension).into_iter();
    let waiting: u64 = files
        .filter_map(|path| Some(std::fs::metadata(path).ok()?.blocks() * BLOCK_BYTES))
        .sum();
    (waiting > MEMORY_BYTES).then(|| "its disk does not take it".to_owned())
}

/// Those with `extension`, oldest name first.
fn files_of(spool: &Path, extension: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(spool).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|found| found == extension))
        .collect();
    files.sort();
    files
}

/// Where behind `position` a file has not been given back to the memory.
fn first_data(file: &File, position: u64) -> io::Result<u64> {
    match seek(file, SeekFrom::Data(position)) {
        Ok(data) => Ok(data),
        // There is nothing behind.
        Err(Errno::NXIO) => Ok(position),
        Err(error) => Err(error.into()),
    }
}

/// Of a file that has no place on the disk yet.
fn generation_of(path: &Path) -> Option<u32> {
    let (generation, number) = path.file_stem()?.to_str()?.split_once('-')?;
    number.parse::<u32>().ok()?;
    generation.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::{SpooledFiles, begin, why_lost};
    use std::io::Write;
    use std::os::unix::fs::MetadataExt;
    use std::path::{Path, PathBuf};

    struct Place(PathBuf);

    impl Place {
        fn new(test: &str) -> Self {
            let place = Path::new("/dev/shm").join(format!("spool_{test}_{}", std::process::id()));
            std::fs::create_dir_all(place.join("disk")).unwrap();
            Self(place)
        }

        fn spool(&self) -> PathBuf {
            self.0.join("spool")
        }

        fn carrier(&self) -> SpooledFiles {
            SpooledFiles::new(&self.spool(), &self.0.join("disk/tlog"), "tlog", 0)
        }

        fn on_disk(&self) -> Vec<Vec<u8>> {
            let mut files: Vec<_> = std::fs::read_dir(self.0.join("disk/tlog"))
                .into_iter()
                .flatten()
                .flatten()
                .map(|entry| entry.path())
                .collect();
            files.sort_by_key(|file| std::fs::metadata(file).unwrap().len());
            files.iter().map(|file| std::fs::read(file).unwrap()).collect()
        }
    }

    impl Drop for Place {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn every_byte_is_carried_once_whoever_carries_and_the_memory_is_given_back() {
        let place = Place::new("once");
        let (mut first, _) = begin(&place.spool(), "tlog", 3).unwrap();
        let (mut second, _) = begin(&place.spool(), "tlog", 3).unwrap();
        let mut carrier = place.carrier();
        let mut written = Vec::new();
        for round in 0..20_u8 {
            let piece = vec![round; 50_000 + usize::from(round)];
            first.write_all(&piece).unwrap();
            written.extend_from_slice(&piece);
            if round % 3 == 0 {
                carrier.carry().unwrap();
            }
            if round % 7 == 0 {
                // The one before was killed.
                carrier = place.carrier();
            }
        }
        second.write_all(b"more").unwrap();
        carrier.carry().unwrap();
        assert!(place.on_disk() == [b"more".to_vec(), written]);
        assert!(first.metadata().unwrap().blocks() < 16);
    }

    #[test]
    fn a_disk_that_cannot_be_written_is_said_and_its_return_too() {
        let place = Place::new("gone");
        let (mut file, _) = begin(&place.spool(), "tlog", 1).unwrap();
        file.write_all(b"one").unwrap();
        let disk = place.0.join("disk");
        std::fs::remove_dir(&disk).unwrap();
        let mut carrier = place.carrier();
        assert!(carrier.carry().is_err());
        assert!(why_lost(&place.spool(), "tlog").is_some_and(|why| why.contains("misspelt")));
        std::fs::create_dir(&disk).unwrap();
        file.write_all(b"two").unwrap();
        carrier.carry().unwrap();
        assert_eq!(place.on_disk(), [b"onetwo".to_vec()]);
        assert_eq!(why_lost(&place.spool(), "tlog"), None);
        // Removed from the disk: it goes on.
        std::fs::remove_dir_all(disk.join("tlog")).unwrap();
        std::fs::create_dir(disk.join("tlog")).unwrap();
        file.write_all(b"three").unwrap();
        carrier.carry().unwrap();
        assert_eq!(place.on_disk(), [b"three".to_vec()]);
    }

    #[test]
    fn what_nobody_carries_is_said_before_it_fills_the_memory() {
        let place = Place::new("uncarried");
        let (mut file, _) = begin(&place.spool(), "tlog", 1).unwrap();
        file.write_all(&vec![1; 1 << 20]).unwrap();
        assert_eq!(why_lost(&place.spool(), "tlog"), None);
        file.write_all(&vec![1; 16 << 20]).unwrap();
        assert!(why_lost(&place.spool(), "tlog").is_some());
    }
}
