//! Checkpoints: all that a run needs to go on as if it had never stopped.
//!
//! Layout, little-endian: magic (8 bytes), format version (u32), scene hash (64 hexadecimal digits), step (u64),
//! time (f64), length of the two parts (u64 each), blake3 of everything before and after itself (32 bytes), the parts:
//! the state of the simulation and that of the recorder, in postcard.

use super::files::write_whole;
use serde::{Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};
use voidage_coupling::error::{Error, Notice, Result};

const MAGIC: &[u8; 8] = b"VOIDAGE\n";
const VERSION: u32 = 12;
const HEAD: usize = 8 + 4 + 64 + 8 + 8 + 8 + 8;
const CHECKSUM: usize = 32;

/// Which run a checkpoint belongs to, and when it was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Stamp {
    /// Hash of the scene, 64 hexadecimal digits.
    pub scene_hash: String,
    /// Steps done.
    pub step: u64,
    /// Time reached, s.
    pub time: f64,
}

/// A checkpoint read back.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// Which run, and when.
    pub stamp: Stamp,
    path: PathBuf,
    state: Vec<u8>,
    recorder: Vec<u8>,
}

impl Checkpoint {
    /// Writes the state of a simulation and of its recorder.
    pub fn write(
        path: &Path,
        stamp: &Stamp,
        state: &impl Serialize,
        recorder: &impl Serialize,
    ) -> Result<()> {
        let encode_error =
            |error| Error::run(format!("{}: cannot encode the state: {error}", path.display()));
        let state = postcard::to_stdvec(state).map_err(encode_error)?;
        let recorder = postcard::to_stdvec(recorder).map_err(encode_error)?;
        let mut head = Vec::with_capacity(HEAD);
        head.extend(MAGIC);
        head.extend(VERSION.to_le_bytes());
        head.extend(format!("{:<64.64}", stamp.scene_hash).as_bytes());
        head.extend(stamp.step.to_le_bytes());
        head.extend(stamp.time.to_le_bytes());
        head.extend((state.len() as u64).to_le_bytes());
        head.extend((recorder.len() as u64).to_le_bytes());
        let checksum = checksum(&head, &state, &recorder);
        write_whole(path, |file| {
            [head.as_slice(), &checksum, &state, &recorder].iter().try_for_each(|part| file.write_all(part))
        })
    }

    /// Reads a checkpoint of the scene with this hash.
    pub fn read(path: &Path, scene_hash: &str) -> Result<Checkpoint> {
        let checkpoint = Checkpoint::open(path)?;
        match checkpoint.stamp.scene_hash == scene_hash {
            true => Ok(checkpoint),
            false => Err(checkpoint.of_another_scene(scene_hash)),
        }
    }

    /// What refuses this checkpoint to a scene of another hash.
    pub fn of_another_scene(&self, scene_hash: &str) -> Error {
        let what = format!(
            "is the checkpoint of another scene (hash {:.12}.., this scene {scene_hash:.12}..)",
            self.stamp.scene_hash
        );
        let help = "restart with the scene.toml beside the checkpoint; `title`, `time.end`, `stop` and `output` may \
                    differ, and \
                    `voidage run` takes changes of many other keys by --set";
        Error::input(Notice::new(what, help).within(self.path.display()))
    }

    /// Reads a checkpoint of any scene.
    pub fn open(path: &Path) -> Result<Checkpoint> {
        let wrong = |what: &str, help: &str| Error::input(Notice::new(what, help).within(path.display()));
        const FILE: &str = "give a file such as OUT/checkpoint.voidage";
        const EARLIER: &str = "use an earlier one";
        let bytes = std::fs::read(path)
            .map_err(|error| wrong(&format!("cannot read the checkpoint: {error}"), FILE))?;
        let head = bytes.get(..HEAD).filter(|head| head.starts_with(MAGIC));
        let Some(head) = head else {
            return Err(wrong("is no checkpoint of voidage", FILE));
        };
        let word = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
        let version = u32::from_le_bytes(std::array::from_fn(|i| head[8 + i]));
        if version != VERSION {
            let what = format!("is a checkpoint of format {version}; this version reads format {VERSION}");
            return Err(wrong(&what, "run from the start"));
        }
        let stamp = Stamp {
            scene_hash: String::from_utf8_lossy(&head[12..76]).trim_end().to_owned(),
            step: word(76),
            time: f64::from_bits(word(84)),
        };
        let (state, recorder) = (word(92) as usize, word(100) as usize);
        let parts = &bytes[HEAD..];
        let whole = CHECKSUM.checked_add(state).and_then(|length| length.checked_add(recorder));
        if whole != Some(parts.len()) {
            return Err(wrong("the checkpoint is cut off", EARLIER));
        }
        let (sum, parts) = parts.split_at(CHECKSUM);
        let (state, recorder) = parts.split_at(state);
        if checksum(head, state, recorder) != sum {
            return Err(wrong("the checkpoint is damaged: its checksum is wrong", EARLIER));
        }
        Ok(Checkpoint { stamp, path: path.to_path_buf(), state: state.to_vec(), recorder: recorder.to_vec() })
    }

    /// The state of the simulation.
    pub fn state<T: DeserializeOwned>(&self) -> Result<T> {
        self.decode(&self.state)
    }

    /// The state of the recorder.
    pub fn recorder<T: DeserializeOwned>(&self) -> Result<T> {
        self.decode(&self.recorder)
    }

    /// What refuses a checkpoint whose checksum is right and whose content is not.
    pub(crate) fn refused(&self, what: &str) -> Error {
        let help = "use an earlier one, or run from the start";
        Error::input(Notice::new(format!("is no state of a run: {what}"), help).within(self.path.display()))
    }

    fn decode<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T> {
        let (decoded, rest) = postcard::take_from_bytes(bytes).map_err(|error| {
            let what = format!("was written by another version of voidage: {error}");
            Error::input(Notice::new(what, "run from the start").within(self.path.display()))
        })?;
        if rest.is_empty() {
            Ok(decoded)
        } else {
            Err(self.refused(&format!("{} bytes are left over", rest.len())))
        }
    }
}

fn checksum(head: &[u8], state: &[u8], recorder: &[u8]) -> [u8; CHECKSUM] {
    let mut hasher = blake3::Hasher::new();
    for part in [head, state, recorder] {
        hasher.update(part);
    }
    *hasher.finalize().as_bytes()
}
