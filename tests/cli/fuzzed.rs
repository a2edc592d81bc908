//! Inputs of the fuzz targets of the program's own files, as `tests/scene/fuzzed.rs` has those of the library's.

#[path = "../../fuzz/src/program.rs"]
mod targets;

use std::path::Path;
use targets::TARGETS;

/// What the name of an input begins with that cannot be used.
const REFUSED: &str = "refused-";

#[test]
fn every_kept_input_holds_and_is_used_or_refused() {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds");
    for (target, check) in TARGETS {
        let mut inputs: Vec<_> = std::fs::read_dir(seeds.join(target)).unwrap().map(|file| file.unwrap()).collect();
        inputs.sort_by_key(|input| input.file_name());
        assert!(!inputs.is_empty(), "{target} has no inputs");
        for input in inputs {
            let name = input.file_name().into_string().unwrap();
            println!("{target}: {name}");
            let is_used = check(&std::fs::read(input.path()).unwrap());
            assert_eq!(is_used, !name.starts_with(REFUSED), "{target}: {name}");
        }
    }
}
