//! Why there is no OpenCL device, or no GPU, and what to do about it.
//!
//! A program reaches a device through a chain: the loader library finds `.icd` files, each names a driver's library,
//! the driver finds devices, and a GPU's driver opens a node under `/dev`. Each link can be missing, and the drivers'
//! own errors (`CL_PLATFORM_NOT_FOUND_KHR`) do not say which. The looks at files are for Linux; elsewhere only the
//! loader's answer counts.

use super::errors::code_name;
use crate::device_info::{DeviceInfo, DeviceKind};
use opencl3::error_codes::ClError;
use serde::Serialize;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

const INSTALL_LOADER: &str = "apt-get install ocl-icd-libopencl1";
const INSTALL_CPU_DRIVER: &str = "apt-get install pocl-opencl-icd (runs on any processor)";
const NVIDIA_LIBRARY: &str = "libnvidia-opencl.so.1";

/// One missing link between raybrook and a device.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// What is wrong.
    pub what: String,
    /// What mends it.
    pub remedy: String,
}

impl Problem {
    fn new(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Problem { what: what.into(), remedy: remedy.into() }
    }

    /// The driver failed when it was asked for its devices.
    pub(super) fn of_failed_driver(name: &str, error: &ClError) -> Self {
        let what = format!("the OpenCL driver '{name}' failed: clGetDeviceIDs: {}", code_name(error.0));
        Problem::new(what, "start again, or restart the computer; or use `device = reference`")
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; to mend it: {}", self.what, self.remedy)
    }
}

/// What is missing on this computer.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Diagnosis {
    /// The most important one first. May hold something although there are devices: a GPU that nothing drives, say.
    pub problems: Vec<Problem>,
}

impl Diagnosis {
    /// The most important problem and its remedy in one line; empty when all is well.
    pub fn summary(&self) -> String {
        self.problems.first().map(Problem::to_string).unwrap_or_default()
    }

    /// The loader library itself is not there.
    pub(super) fn of_missing_loader() -> Self {
        let (library, remedy) = if cfg!(target_os = "windows") {
            ("OpenCL.dll", "install the graphics driver of your GPU's maker")
        } else if cfg!(target_os = "macos") {
            ("OpenCL.framework", "it is part of macOS; repair the system")
        } else {
            ("libOpenCL.so.1", INSTALL_LOADER)
        };
        Diagnosis {
            problems: vec![Problem::new(format!("the OpenCL loader {library} was not found or does not load"), remedy)],
        }
    }

    /// The loader works: looks at the links behind it. `devices` are those that were found, and `empty_platforms` the
    /// drivers without any.
    pub(super) fn of_this_computer<'a>(
        devices: impl Iterator<Item = &'a DeviceInfo>,
        empty_platforms: &[String],
    ) -> Self {
        let kinds: Vec<_> = devices.map(|info| info.kind).collect();
        let found = Found { any: !kinds.is_empty(), gpu: kinds.contains(&DeviceKind::Gpu), empty_platforms };
        if cfg!(target_os = "linux") { examine(&Computer::here(), &found) } else { examine_platforms(&found) }
    }
}

/// What OpenCL itself told.
struct Found<'a> {
    any: bool,
    gpu: bool,
    empty_platforms: &'a [String],
}

/// Where to look; tests look elsewhere.
struct Computer<'a> {
    /// What the loader reads: a folder of `.icd` files or one such file.
    vendors: PathBuf,
    /// The variable that named `vendors`, if one did.
    vendors_variable: Option<&'static str>,
    /// Where the dynamic linker finds libraries.
    library_folders: Vec<PathBuf>,
    /// The folder of device nodes.
    dev: PathBuf,
    /// Whether a device node can be opened.
    open: &'a dyn Fn(&Path) -> io::Result<()>,
}

impl Computer<'_> {
    fn here() -> Self {
        // The variables that ocl-icd and Khronos' loader know, in ocl-icd's order.
        let named = ["OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"]
            .into_iter()
            .find_map(|name| Some((name, std::env::var_os(name).filter(|value| !value.is_empty())?)));
        Computer {
            vendors: named
                .as_ref()
                .map_or_else(|| PathBuf::from("/etc/OpenCL/vendors"), |(_, value)| PathBuf::from(value)),
            vendors_variable: named.map(|(name, _)| name),
            library_folders: library_folders(std::env::var_os("LD_LIBRARY_PATH"), Path::new("/etc/ld.so.cache")),
            dev: PathBuf::from("/dev"),
            open: &|node| std::fs::OpenOptions::new().read(true).write(true).open(node).map(drop),
        }
    }

    fn has_library(&self, name: &str) -> bool {
        // With a slash it is a path; the linker searches its folders only for plain names.
        if name.contains('/') {
            Path::new(name).exists()
        } else {
            self.library_folders.iter().any(|f| f.join(name).exists())
        }
    }

    /// The `.icd` files that the loader reads.
    fn icd_files(&self) -> Vec<PathBuf> {
        let is_icd = |path: &Path| path.extension().is_some_and(|extension| extension == "icd");
        if is_icd(&self.vendors) && self.vendors.is_file() {
            return vec![self.vendors.clone()];
        }
        sorted_entries(&self.vendors).into_iter().filter(|path| is_icd(path)).collect()
    }

    /// The nodes of GPUs: NVIDIA's, and those of everybody else.
    fn gpu_nodes(&self) -> (Vec<PathBuf>, Vec<PathBuf>) {
        let name_starts =
            |path: &Path, start: &str| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(start));
        let mut nvidia = sorted_entries(&self.dev);
        nvidia.retain(|path| {
            let number = path.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_prefix("nvidia"));
            number.is_some_and(|n| n == "ctl" || n.parse::<u32>().is_ok())
        });
        let mut others = sorted_entries(&self.dev.join("dri"));
        others.retain(|path| name_starts(path, "renderD"));
        others.extend(Some(self.dev.join("kfd")).filter(|kfd| kfd.exists()));
        (nvidia, others)
    }
}

fn sorted_entries(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// The folders of `$LD_LIBRARY_PATH`, those that the linker's cache mentions, and the linker's own.
fn library_folders(variable: Option<OsString>, cache: &Path) -> Vec<PathBuf> {
    let mut folders: Vec<_> = variable.iter().flat_map(std::env::split_paths).collect();
    // The cache is a table over strings that end with a zero; those that begin with a slash are the libraries' paths.
    let cache = std::fs::read(cache).unwrap_or_default();
    let paths = cache.split(|&byte| byte == 0).filter(|text| text.starts_with(b"/"));
    let cached: BTreeSet<_> = paths.filter_map(|text| Path::new(std::str::from_utf8(text).ok()?).parent()).collect();
    folders.extend(cached.into_iter().map(Path::to_owned));
    folders.extend(["/lib", "/usr/lib", "/lib64", "/usr/lib64"].map(PathBuf::from));
    folders
}

fn examine(computer: &Computer<'_>, found: &Found<'_>) -> Diagnosis {
    let mut problems = examine_drivers(computer, found);
    problems.extend(examine_platforms(found).problems);
    if !found.gpu {
        problems.extend(examine_nodes(computer));
    }
    if problems.is_empty() && !found.any {
        let what = format!("the OpenCL drivers in '{}' were not loaded", computer.vendors.display());
        problems.push(Problem::new(what, INSTALL_CPU_DRIVER));
    }
    Diagnosis { problems }
}

/// The `.icd` files, and the libraries that they name.
fn examine_drivers(computer: &Computer<'_>, found: &Found<'_>) -> Vec<Problem> {
    let files = computer.icd_files();
    if files.is_empty() && !found.any {
        let folder = computer.vendors.display();
        return vec![match computer.vendors_variable {
            Some(variable) => Problem::new(
                format!("no OpenCL driver: there is no .icd file in '{folder}', which the variable {variable} names"),
                format!("unset {variable}, or {INSTALL_CPU_DRIVER}"),
            ),
            None => Problem::new(format!("no OpenCL driver: there is no .icd file in '{folder}'"), INSTALL_CPU_DRIVER),
        }];
    }
    files.iter().filter_map(|file| examine_icd(computer, file)).collect()
}

fn examine_icd(computer: &Computer<'_>, file: &Path) -> Option<Problem> {
    let shown = file.display();
    let remedy = || format!("install the driver that it belongs to again, or remove the file; or {INSTALL_CPU_DRIVER}");
    let text = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(error) => {
            return Some(Problem::new(format!("the driver's file '{shown}' cannot be read: {error}"), remedy()));
        }
    };
    match text.lines().next().map(str::trim).filter(|library| !library.is_empty()) {
        None => Some(Problem::new(format!("the driver's file '{shown}' names no library"), remedy())),
        Some(library) if !computer.has_library(library) => Some(Problem::new(
            format!("the driver's file '{shown}' names the library '{library}', which is not there"),
            remedy(),
        )),
        Some(_) => None,
    }
}

/// Drivers without devices; only worth a word where there is no other device.
fn examine_platforms(found: &Found<'_>) -> Diagnosis {
    if found.any {
        return Diagnosis::default();
    }
    let problem = |platform: &String| {
        let remedy = match platform.as_str() {
            // Mesa's driver offers nothing unless it is told what to drive.
            "rusticl" => format!("RUSTICL_ENABLE=radeonsi, iris, … for the GPU's driver; or {INSTALL_CPU_DRIVER}"),
            _ => INSTALL_CPU_DRIVER.to_owned(),
        };
        Problem::new(format!("the OpenCL driver '{platform}' found no device"), remedy)
    };
    Diagnosis { problems: found.empty_platforms.iter().map(problem).collect() }
}

/// GPUs that the system knows although OpenCL offers none.
fn examine_nodes(computer: &Computer<'_>) -> Vec<Problem> {
    let (nvidia, others) = computer.gpu_nodes();
    let mut problems = Vec::new();
    let is_denied = |node: &&PathBuf| (computer.open)(node).is_err_and(|e| e.kind() == io::ErrorKind::PermissionDenied);
    let denied: Vec<_> =
        nvidia.iter().chain(&others).filter(is_denied).map(|node| node.display().to_string()).collect();
    if !denied.is_empty() {
        problems.push(Problem::new(
            format!("no permission to open {}", denied.join(", ")),
            "sudo usermod -aG render,video $USER, then log in again; in a container, pass the device on",
        ));
    } else if let Some(node) = nvidia.first() {
        let remedy = if computer.has_library(NVIDIA_LIBRARY) {
            // Usual in containers: the driver's library is passed on, the file that names it is not.
            format!("echo {NVIDIA_LIBRARY} > /etc/OpenCL/vendors/nvidia.icd")
        } else {
            "apt-get install nvidia-opencl-icd; in a container, NVIDIA_DRIVER_CAPABILITIES=compute,utility".to_owned()
        };
        problems.push(Problem::new(
            format!("there is an NVIDIA GPU ({}), but OpenCL does not offer it", node.display()),
            remedy,
        ));
    } else if let Some(node) = others.first() {
        problems.push(Problem::new(
            format!("there is a GPU ({}), but OpenCL does not offer it", node.display()),
            "apt-get install intel-opencl-icd (Intel) or mesa-opencl-icd (AMD)",
        ));
    }
    problems
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: Found<'static> = Found { any: false, gpu: false, empty_platforms: &[] };

    /// A computer with the given files (path below its root, text), where every node opens.
    struct Scratch(tempfile::TempDir);

    impl Scratch {
        fn new(files: &[(&str, &str)]) -> Self {
            let root = tempfile::tempdir().unwrap();
            for (path, text) in files {
                let path = root.path().join(path);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, text).unwrap();
            }
            Scratch(root)
        }

        fn problems(&self, found: &Found<'_>) -> Vec<String> {
            self.problems_where(found, None, &|_| Ok(()))
        }

        fn problems_where(
            &self,
            found: &Found<'_>,
            vendors_variable: Option<&'static str>,
            open: &dyn Fn(&Path) -> io::Result<()>,
        ) -> Vec<String> {
            let at = |path: &str| self.0.path().join(path);
            let computer = Computer {
                vendors: at("vendors"),
                vendors_variable,
                library_folders: vec![at("lib")],
                dev: at("dev"),
                open,
            };
            let root = format!("{}/", self.0.path().display());
            examine(&computer, found).problems.iter().map(|p| p.to_string().replace(&root, "")).collect()
        }
    }

    #[test]
    fn no_driver_at_all() {
        let expected =
            "no OpenCL driver: there is no .icd file in 'vendors'; to mend it: apt-get install pocl-opencl-icd";
        let problems = Scratch::new(&[]).problems(&NOTHING);
        assert!(problems.len() == 1 && problems[0].starts_with(expected), "{problems:?}");
        let problems =
            Scratch::new(&[("vendors/readme.txt", "x")]).problems_where(&NOTHING, Some("OCL_ICD_VENDORS"), &|_| Ok(()));
        assert!(
            problems[0].contains("OCL_ICD_VENDORS names; to mend it: unset OCL_ICD_VENDORS, or apt-get"),
            "{problems:?}"
        );
    }

    #[test]
    fn a_driver_without_its_library() {
        for (icd, expected) in [
            ("libgone.so.1\n", "'vendors/a.icd' names the library 'libgone.so.1', which is not there; to mend it: "),
            ("/nowhere/libgone.so\n", "names the library '/nowhere/libgone.so', which is not there"),
            ("\n", "'vendors/a.icd' names no library"),
            ("", "'vendors/a.icd' names no library"),
        ] {
            let problems = Scratch::new(&[("vendors/a.icd", icd)]).problems(&NOTHING);
            assert!(problems.len() == 1 && problems[0].contains(expected), "{problems:?}");
        }
        // Also told where another driver works.
        let computer =
            Scratch::new(&[("vendors/a.icd", "libgone.so"), ("vendors/b.icd", "libgood.so"), ("lib/libgood.so", "")]);
        assert_eq!(computer.problems(&Found { any: true, gpu: true, empty_platforms: &[] }).len(), 1);
    }

    #[test]
    fn a_driver_without_devices() {
        let computer = Scratch::new(&[("vendors/a.icd", "libgood.so"), ("lib/libgood.so", "")]);
        let empty = ["rusticl".to_owned()];
        let problems = computer.problems(&Found { empty_platforms: &empty, ..NOTHING });
        assert!(
            problems.len() == 1 && problems[0].starts_with("the OpenCL driver 'rusticl' found no device"),
            "{problems:?}"
        );
        assert!(problems[0].contains("RUSTICL_ENABLE"), "{problems:?}");
        assert!(computer.problems(&Found { any: true, empty_platforms: &empty, ..NOTHING }).is_empty());
        assert!(computer.problems(&NOTHING)[0].contains("were not loaded"));
    }

    #[test]
    fn a_gpu_that_may_not_be_opened() {
        let files = [
            ("vendors/a.icd", "libgood.so"),
            ("lib/libgood.so", ""),
            ("dev/dri/renderD128", ""),
            ("dev/dri/card0", ""),
        ];
        let denied = |_: &Path| Err(io::Error::from(io::ErrorKind::PermissionDenied));
        let computer = Scratch::new(&files);
        let with_cpu = Found { any: true, gpu: false, empty_platforms: &[] };
        let problems = computer.problems_where(&with_cpu, None, &denied);
        assert!(
            problems.len() == 1 && problems[0].starts_with("no permission to open dev/dri/renderD128;"),
            "{problems:?}"
        );
        assert!(problems[0].contains("usermod -aG render,video"), "{problems:?}");
        let with_gpu = Found { any: true, gpu: true, empty_platforms: &[] };
        assert!(computer.problems_where(&with_gpu, None, &denied).is_empty());
    }

    #[test]
    fn a_gpu_that_nothing_drives() {
        let with_cpu = Found { any: true, gpu: false, empty_platforms: &[] };
        for (files, expected) in [
            (&[("dev/kfd", "")][..], "there is a GPU (dev/kfd), but OpenCL does not offer it"),
            (&[("dev/nvidia0", ""), ("dev/dri/renderD128", "")], "nvidia-opencl-icd"),
            (&[("dev/nvidiactl", ""), ("lib/libnvidia-opencl.so.1", "")], "echo libnvidia-opencl.so.1 > "),
        ] {
            let problems = Scratch::new(files).problems(&with_cpu);
            assert!(problems.len() == 1 && problems[0].contains(expected), "{problems:?}");
        }
        assert!(Scratch::new(&[("dev/nvidia-uvm", ""), ("dev/null", "")]).problems(&with_cpu).is_empty());
    }

    #[test]
    fn libraries_are_found_where_the_linker_finds_them() {
        let root = tempfile::tempdir().unwrap();
        let cache = root.path().join("ld.so.cache");
        std::fs::write(&cache, b"magic\0libx.so\0/opt/x/libx.so\0/opt/x/liby.so\0\xff\xfe\0").unwrap();
        let folders = library_folders(Some("/first:/second".into()), &cache);
        let start: Vec<_> = folders[..3].iter().map(|f| f.to_str().unwrap()).collect();
        assert_eq!(start, ["/first", "/second", "/opt/x"]);
        assert!(library_folders(None, Path::new("/nowhere/ld.so.cache")).contains(&PathBuf::from("/usr/lib")));
    }

    #[test]
    fn a_missing_loader_names_its_package() {
        if cfg!(target_os = "linux") {
            assert!(Diagnosis::of_missing_loader().summary().ends_with("apt-get install ocl-icd-libopencl1"));
        }
        assert_eq!(Diagnosis::default().summary(), "");
    }
}
