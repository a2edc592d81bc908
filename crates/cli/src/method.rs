//! The options of methods. Their names, values and texts are those of the library's table.

use super::values::Named;
use super::{Talk, flags};
use clap::{Arg, ArgMatches, Command, FromArgMatches};
use raybrook::Error;
use raybrook::low_level::choose::{Chosen, Request, TunedChoice, Workload};
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::options::{
    Build, Choice, Heading, Intersector, MethodOption, OPTIONS, PacketSize, StructureKind, TraceOptions, Traversal,
    parse_method,
};

/// The flag that takes a whole method.
const METHOD: &str = "method";
const PRECISION: &str = "precision";
/// What leaves the choice of the structure to the program.
pub const AUTO: &str = "auto";
/// Flags of earlier versions, which are understood for one more release, and what they are called now.
const OLD_FLAGS: [(&str, &str); 1] = [("accel", StructureKind::OPTION)];
/// Values of earlier versions, by option: likewise.
const OLD_VALUES: [(&str, &str, &str); 1] = [("kernels", "split", "wavefront")];

/// What to trace with.
pub struct MethodArgs {
    request: Request,
}

impl clap::Args for MethodArgs {
    fn augment_args(command: Command) -> Command {
        let command = command.arg(method()).arg(precision());
        OPTIONS.iter().fold(command, |command, option| command.arg(argument(option)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

fn method() -> Arg {
    let names = [
        ("structure", StructureKind::names()),
        ("build of a kd-tree", Build::names()),
        ("traversal of a kd-tree", Traversal::names()),
        ("triangle test", Intersector::names()),
    ];
    let lists: Vec<_> = names.iter().map(|(part, names)| format!("{part}: {names}")).collect();
    let options = [StructureKind::OPTION, Build::OPTION, Traversal::OPTION, Intersector::OPTION];
    let parts = OPTIONS.iter().filter(|option| options.contains(&option.name)).flat_map(MethodOption::choices);
    let parts = parts.filter_map(|choice| choice.name());
    Arg::new(METHOD)
        .long(METHOD)
        .value_name("PARTS")
        .help_heading(Heading::Accuracy.name())
        .help("How hits are found, such as bvh8; for experts: see `raybrook methods` [default: the fastest exact one]")
        .long_help(format!(
            "How hits are found: structure, build, traversal and triangle test, joined by '+' in any order, such as \
             bvh8 or kd+ropes+plucker [default: the fastest on the device, with exact hits]. What is left out is left \
             to the program. `raybrook methods` explains the parts:\n{}",
            lists.join("\n")
        ))
        .hide_possible_values(true)
        .value_parser(Named::new(parts, |text: &str| parse_method(text).map_err(|error| what(&error))))
}

fn precision() -> Arg {
    Arg::new(PRECISION)
        .long(PRECISION)
        .value_name("exact|fast")
        .help_heading(Heading::Accuracy.name())
        .help("exact: every hit is right; fast: rounding makes a few wrong [default: exact]")
        .long_help(
            "Whether every hit is right [default: exact]\n\
             exact: Every hit is the one that exact arithmetic finds.\n\
             fast: The fastest float32 test, moller-trumbore: rounding loses a few hits, and makes a few wrong. On a \
             CPU, where rays of both go in packets, it is about as fast as exact.",
        )
        .conflicts_with(Intersector::OPTION)
        .hide_possible_values(true)
        .value_parser(Named::new(["exact", "fast"], |text: &str| {
            let intersector = match text {
                "exact" => Intersector::Exact,
                "fast" => Intersector::FASTEST,
                _ => return Err("possible: exact, fast".to_owned()),
            };
            parse_method(intersector.name()).map_err(|error| what(&error))
        }))
}

/// A value of an option; `None` is `auto`.
type Asked = Option<Choice>;

/// The argument of an option of the table.
fn argument(option: &'static MethodOption) -> Arg {
    let is_structure = option.name == StructureKind::OPTION;
    let mut values: Vec<_> =
        option.choices().filter_map(|choice| Some(format!("{}: {}", choice.name()?, choice.about()?))).collect();
    if is_structure {
        values.insert(0, format!("{AUTO}: {AUTO_STRUCTURE}"));
    }
    let names = option.choices().filter_map(|choice| choice.name());
    let about = format!("{} [default: {}]", option.about().trim_end_matches('.'), option.default_words());
    let only = flags::only_with(option.structures).map_or(String::new(), |only| format!(". {only}"));
    let long = [&format!("{about}{only}")[..], &values.join("\n")].join("\n");
    let argument = Arg::new(option.name)
        .long(option.name.replace('_', "-"))
        .value_name(option.value_name())
        .help_heading(option.heading.name())
        .help(about)
        .long_help(long.trim_end().to_owned())
        .hide_short_help(true)
        .allow_negative_numbers(true)
        .hide_possible_values(true)
        .value_parser(Named::new(
            is_structure.then_some(AUTO).into_iter().chain(names),
            move |text: &str| match option.parse(text) {
                _ if is_structure && text == AUTO => Ok(Asked::None),
                Err(_) if is_structure => Err(format!("no '{text}'; possible: {AUTO}, {}", StructureKind::names())),
                choice => choice.map(Some).map_err(|error| what(&error)),
            },
        ));
    let old = OLD_FLAGS.iter().filter(|(_, name)| *name == option.name);
    old.fold(argument, |argument, (old, _)| argument.alias(*old))
}

/// How the program chooses a structure.
const AUTO_STRUCTURE: &str = "what `raybrook tune` found on the device, else bvh8 on a CPU, bvh2 on a GPU; on the \
    reference kd for 100 to 299999 triangles, bvh2 for fewer or more; instances where these share a million triangles, \
    on a GPU 65536; or what other options are for, such as kd with --build (info and tables of methods prefer kd)";

/// What is wrong with a value: its flag stands before it already.
fn what(error: &Error) -> String {
    match error {
        Error::Option { message, .. } => flags::in_flags(message).into_owned(),
        other => other.to_string(),
    }
}

impl FromArgMatches for MethodArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut request = Request::default();
        for option in OPTIONS {
            if let Some(Some(choice)) = matches.get_one::<Asked>(option.name) {
                request.give(*choice);
            }
        }
        let precision = matches.get_one::<Vec<Choice>>(PRECISION);
        precision.into_iter().flatten().for_each(|choice| request.give(*choice));
        for choice in matches.get_one::<Vec<Choice>>(METHOD).into_iter().flatten() {
            if request.has(choice.option().name) {
                let message = format!(
                    "--{METHOD} has {}, and {} is given, too; give it once\n",
                    flags::typed(choice),
                    flags::flag(choice.option().name)
                );
                return Err(clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, message));
            }
            request.give(*choice);
        }
        Ok(MethodArgs { request })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl MethodArgs {
    /// What the user asks for.
    fn request(&self, counters: bool) -> Request {
        self.request.clone().with_counters(counters)
    }

    /// The same with other parts, each an option and the name of its value, or `auto`, which leaves it to the program.
    pub fn with(&self, parts: &[(&str, &str)]) -> Result<MethodArgs, Error> {
        let mut request = self.request.clone();
        for &(option, value) in parts {
            match value {
                AUTO => request.leave(option),
                value => request.set(option, value)?,
            }
        }
        Ok(MethodArgs { request })
    }

    /// The value that is asked for of an option, or `auto`.
    pub fn asked(&self, option: &str) -> &'static str {
        let given = self.request.given().iter().find(|choice| choice.option().name == option);
        given.and_then(Choice::name).unwrap_or(AUTO)
    }

    /// What is wrong with the options on any device comes before what takes time.
    pub fn check(&self, counters: bool) -> Result<TraceOptions, Error> {
        Ok(self.request(counters).choose(&Workload::without_scene(None), None)?.options)
    }

    /// The options, with what is fastest on `device` where the user leaves the choice, for no scene in particular.
    pub fn options_for(
        &self,
        device: Option<&DeviceHandle>,
        counters: bool,
        talk: Talk,
    ) -> Result<TraceOptions, Error> {
        let workload = Workload::without_scene(device.map(|device| &device.info));
        Ok(self.choose(&workload, None, counters, talk)?.options)
    }

    /// Chooses what the user leaves open. Says so where a limit of the fastest structure leads to another one, which
    /// nobody asked for.
    pub fn choose(
        &self,
        workload: &Workload,
        tuned: Option<&TunedChoice>,
        counters: bool,
        talk: Talk,
    ) -> Result<Chosen, Error> {
        let mut chosen = self.request(counters).choose(workload, tuned)?;
        if let Some(limit) = chosen.limit.as_ref().filter(|_| !talk.quiet) {
            let (structure, limit) = (flags::flag(StructureKind::OPTION), flags::in_flags(limit));
            tell!("note: {structure} {AUTO} takes {}: {limit}", chosen.options.kind());
        }
        chosen.decisions = flags::decisions(chosen.decisions);
        Ok(chosen)
    }

    /// Whether structure or packets are left to be chosen.
    pub fn leaves_a_choice(&self) -> bool {
        !self.request.has(StructureKind::OPTION) || !self.request.has(PacketSize::OPTION)
    }

    /// Whether a structure is asked for.
    pub fn has_structure(&self) -> bool {
        self.request.has(StructureKind::OPTION)
    }

    /// The options, with the `preferred` structure where the user leaves the choice and nothing else needs another one.
    pub fn options(&self, preferred: StructureKind, counters: bool) -> Result<TraceOptions, Error> {
        self.request(counters).with_structure(preferred)
    }
}

/// Says which names of earlier versions the arguments have.
pub fn note_old_names(arguments: impl Iterator<Item = String>) {
    let arguments: Vec<_> = arguments.take_while(|word| word != "--").collect();
    let has =
        |flag: &str, word: &str| word == flag || word.strip_prefix(flag).is_some_and(|rest| rest.starts_with('='));
    for (old, name) in OLD_FLAGS {
        let (old, new) = (flags::flag(old), flags::flag(name));
        if arguments.iter().any(|word| has(&old, word)) {
            tell!("note: {old} is called {new} now; the next release knows it no more");
        }
    }
    for (name, old, new) in OLD_VALUES {
        let flag = flags::flag(name);
        let is_apart = arguments.windows(2).any(|pair| pair[0] == flag && pair[1] == old);
        if is_apart || arguments.contains(&format!("{flag}={old}")) {
            tell!("note: {flag} {old} is called {flag} {new} now; the next release knows it no more");
        }
    }
}
