//! Which part of the work on a picture a run does: as it is told, or as whatever started it on many machines says.

use raybrook::low_level::renderer::Part;
use raybrook::{Error, Result};
use std::str::FromStr;

/// As in the option.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PartChoice {
    /// This one.
    Given(Part),
    /// As the environment says.
    Auto,
}

impl FromStr for PartChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<PartChoice, String> {
        match text {
            "auto" => Ok(PartChoice::Auto),
            part => part.parse().map(PartChoice::Given).map_err(|error| format!("{error}, or auto")),
        }
    }
}

/// What tells one of many programs which it is: variables of its number, of the first one's number, of the step from
/// one to the next, and of how many there are.
struct Engine {
    name: &'static str,
    number: &'static str,
    first: Option<&'static str>,
    step: Option<&'static str>,
    count: &'static str,
}

/// Those that start the program last come first: they are the most particular.
const ENGINES: [Engine; 4] = [
    Engine { name: "Open MPI", number: "OMPI_COMM_WORLD_RANK", first: None, step: None, count: "OMPI_COMM_WORLD_SIZE" },
    Engine { name: "PMI", number: "PMI_RANK", first: None, step: None, count: "PMI_SIZE" },
    Engine { name: "Slurm's srun", number: "SLURM_PROCID", first: None, step: None, count: "SLURM_NTASKS" },
    Engine {
        name: "a Slurm array",
        number: "SLURM_ARRAY_TASK_ID",
        first: Some("SLURM_ARRAY_TASK_MIN"),
        step: Some("SLURM_ARRAY_TASK_STEP"),
        count: "SLURM_ARRAY_TASK_COUNT",
    },
];

impl Engine {
    /// The part, if the variables are there.
    fn part(&self, variable: impl Fn(&str) -> Option<String>) -> Result<Option<Part>> {
        let number = |name: &str| -> Result<Option<u32>> {
            let Some(text) = variable(name) else { return Ok(None) };
            let wrong = |_| Error::option("--part", format!("auto: {name} is '{text}', which is no number"));
            text.trim().parse().map(Some).map_err(wrong)
        };
        let or = |name: Option<&str>, default| Ok::<_, Error>(name.map_or(Ok(None), number)?.unwrap_or(default));
        let (Some(id), Some(of)) = (number(self.number)?, number(self.count)?) else { return Ok(None) };
        let (first, step) = (or(self.first, 0)?, or(self.step, 1)?.max(1));
        let part = id.checked_sub(first).map(|behind| behind / step + 1);
        match part.filter(|number| (1..=of).contains(number) && of <= Part::MOST) {
            Some(number) => Ok(Some(Part { number, of })),
            None => {
                let message = format!("auto: {} {id} of {of} by {} is no part of the work", self.number, self.name);
                Err(Error::option("--part", message))
            }
        }
    }
}

impl PartChoice {
    /// Which part that is.
    ///
    /// # Errors
    /// [`Error::Option`] when the environment says nothing, or nothing that makes sense.
    pub fn part(self) -> Result<Part> {
        match self {
            PartChoice::Given(part) => Ok(part),
            PartChoice::Auto => part_of(|name| std::env::var(name).ok()),
        }
    }
}

fn part_of(variable: impl Fn(&str) -> Option<String>) -> Result<Part> {
    let parts = ENGINES.iter().map(|engine| engine.part(&variable)).collect::<Result<Vec<_>>>()?;
    let mut parts = parts.into_iter().flatten();
    // A step of a job may be one of one, where the job is one of many.
    let alone = parts.clone().next();
    parts.find(|part| part.of > 1).or(alone).ok_or_else(|| {
        let names = ENGINES.map(|engine| engine.number).join(", ");
        Error::option("--part", format!("auto: none of {names} is set; give the part as I/N"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn auto(variables: &[(&str, &str)]) -> std::result::Result<String, String> {
        let of = |name: &str| variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned());
        part_of(of).map(|part| part.to_string()).map_err(|error| error.to_string())
    }

    #[test]
    fn ranks_and_arrays_become_parts() {
        let array = |id, first, step, count| {
            auto(&[
                ("SLURM_ARRAY_TASK_ID", id),
                ("SLURM_ARRAY_TASK_MIN", first),
                ("SLURM_ARRAY_TASK_STEP", step),
                ("SLURM_ARRAY_TASK_COUNT", count),
                ("SLURM_PROCID", "0"),
                ("SLURM_NTASKS", "1"),
            ])
        };
        assert_eq!(array("0", "0", "1", "16"), Ok("1/16".to_owned()));
        assert_eq!(array("16", "1", "1", "16"), Ok("16/16".to_owned()));
        assert_eq!(array("14", "2", "4", "5"), Ok("4/5".to_owned()));
        assert_eq!(auto(&[("OMPI_COMM_WORLD_RANK", "3"), ("OMPI_COMM_WORLD_SIZE", "4")]), Ok("4/4".to_owned()));
        assert_eq!(auto(&[("PMI_RANK", "0"), ("PMI_SIZE", "2")]), Ok("1/2".to_owned()));
        assert_eq!(auto(&[("SLURM_PROCID", "1"), ("SLURM_NTASKS", "2")]), Ok("2/2".to_owned()));
        assert_eq!(auto(&[("PMI_RANK", "0"), ("PMI_SIZE", "1")]), Ok("1/1".to_owned()));
    }

    #[test]
    fn an_environment_that_makes_no_sense_is_told_of() {
        for (variables, says) in [
            (&[][..], "give the part as I/N"),
            (&[("PMI_RANK", "2"), ("PMI_SIZE", "2")], "PMI_RANK 2 of 2"),
            (&[("PMI_RANK", "x"), ("PMI_SIZE", "2")], "'x', which is no number"),
            (
                &[("SLURM_ARRAY_TASK_ID", "1"), ("SLURM_ARRAY_TASK_MIN", "5"), ("SLURM_ARRAY_TASK_COUNT", "2")],
                "no part",
            ),
        ] {
            let message = auto(variables).unwrap_err();
            assert!(message.contains("--part") && message.contains(says), "{message}");
        }
    }

    #[test]
    fn parts_are_typed_as_i_of_n() {
        assert_eq!("3/16".parse(), Ok(PartChoice::Given(Part { number: 3, of: 16 })));
        assert_eq!("auto".parse(), Ok(PartChoice::Auto));
        for wrong in ["", "0/4", "5/4", "1", "1/0", "a/b", "1/1000001", "-1/4"] {
            assert!(wrong.parse::<PartChoice>().unwrap_err().contains("such as 3/16"), "{wrong}");
        }
    }
}
