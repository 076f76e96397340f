//! The launcher that started this process, by the variables that it sets, and whether the MPI that
//! the program is linked with can be started by it.

use std::time::Duration;

/// A variable of the environment.
pub(crate) fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok()
}

/// Name and version of the MPI library, in one line.
pub fn library_version() -> String {
    in_one_line(&mpi::environment::library_version().unwrap_or_default())
}

fn in_one_line(text: &str) -> String {
    let line = text.lines().next().unwrap_or_default();
    // MPICH has a table, Open MPI adds who built it.
    let line = line.split_once(", package").map_or(line, |(line, _)| line);
    let words: Vec<&str> = line.split_whitespace().collect();
    words.join(" ")
}

/// The variable by which a launcher tells its processes that they are several, and their number.
/// `process`: this one.
pub(crate) fn launched(
    variable: impl Fn(&str) -> Option<String>,
    process: u32,
) -> Option<(&'static str, u64)> {
    let mut found = launchers(variable, process);
    found.find(|(_, ranks)| *ranks > 1)
}

/// The variable by which a launcher tells this process that it is a rank, even a single one.
pub fn launcher_variable() -> Option<&'static str> {
    let (name, _) = launchers(variable, std::process::id()).next()?;
    Some(name)
}

/// The variables of launchers that a process has, each with the number of ranks that it tells.
fn launchers(
    variable: impl Fn(&str) -> Option<String>,
    process: u32,
) -> impl Iterator<Item = (&'static str, u64)> {
    let number = |name: &str| variable(name)?.parse::<u64>().ok();
    // Other processes of a job script have the variables of the batch system, too: the script's own
    // programs, and those that mpirun starts on other nodes.
    let is_task = number("SLURM_TASK_PID") == Some(process.into());
    let named = |name| Some((name, number(name)?));
    let found = [
        named("OMPI_COMM_WORLD_SIZE"),
        named("PMI_SIZE"),
        if is_task {
            named("SLURM_STEP_NUM_TASKS")
        } else {
            None
        },
        // The number of its ranks is not in the environment.
        number("PMIX_RANK").map(|rank| ("PMIX_RANK", rank + 1)),
    ];
    found.into_iter().flatten()
}

/// A launcher that cannot start the ranks of this MPI.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ForeignLauncher {
    /// What is wrong, and what would be right.
    pub message: String,
    /// Whether this process is the one that is to say so.
    pub is_first: bool,
}

impl ForeignLauncher {
    /// The launcher of this process, if it is one. MPI needs not be started: MPICH ends the process
    /// in its start then.
    pub fn find() -> Option<Self> {
        let library = mpi::environment::library_version().unwrap_or_default();
        let foreign = foreign(&library, variable)?;
        let program = std::env::current_exe().ok();
        // As in an environment of Python.
        let beside = program.map(|program| program.with_file_name("mpiexec"));
        let beside = beside.filter(|path| foreign.needs == Needs::Mpich && path.exists());
        let launcher = match (&beside, foreign.needs) {
            (Some(path), _) => path.display().to_string(),
            (None, Needs::Mpich) => {
                "the mpiexec of that MPI (of Debian's MPICH mpiexec.mpich)".into()
            }
            (None, Needs::OpenMpi) => "Open MPI's mpirun".into(),
        };
        Some(Self {
            message: format!(
                "{}, but the program is linked with {}, which needs a launcher of its own; start it with {launcher}{}",
                foreign.found,
                in_one_line(&library),
                foreign.otherwise
            ),
            is_first: foreign.rank == 0,
        })
    }

    /// Lets the first rank speak before this one ends: the launcher ends all when one does.
    pub fn give_way(&self) {
        if !self.is_first {
            std::thread::sleep(PATIENCE);
        }
    }
}

/// How long the other ranks wait.
const PATIENCE: Duration = Duration::from_secs(1);

/// The launcher that a program needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Needs {
    Mpich,
    OpenMpi,
}

/// What [`ForeignLauncher`] is made of.
#[derive(Debug, PartialEq, Eq)]
struct Foreign {
    /// What the environment says.
    found: String,
    needs: Needs,
    /// What else would do.
    otherwise: &'static str,
    rank: u64,
}

/// Variables of other launchers that speak the protocol of MPICH's: Slurm, Flux, PALS, ALPS, and
/// IBM's jsrun. Their MPI may be any.
const OTHER_LAUNCHERS: [&str; 5] = [
    "SLURM_PROCID",
    "FLUX_TASK_RANK",
    "PALS_RANKID",
    "ALPS_APP_PE",
    "JSM_NAMESPACE_RANK",
];

/// The launcher, if it is certainly one that cannot start this library. Where it may be able to,
/// [`World::check_launcher`](crate::World::check_launcher) tells.
fn foreign(library: &str, variable: impl Fn(&str) -> Option<String>) -> Option<Foreign> {
    let number = |name: &str| variable(name)?.parse::<u64>().ok();
    let is_set = |name: &str| variable(name).is_some();
    let as_one = |ranks: u64| match ranks {
        1 => "a single rank".to_string(),
        ranks => format!("one of {ranks} ranks"),
    };
    let from_hydra = number("PMI_RANK").zip(number("PMI_SIZE"));
    if library.starts_with("Open MPI") {
        let (rank, ranks) = from_hydra?;
        let is_hydra =
            is_set("HYDI_CONTROL_FD") || !OTHER_LAUNCHERS.iter().any(|other| is_set(other));
        let is_open_mpi = is_set("OMPI_COMM_WORLD_SIZE") || is_set("PMIX_RANK");
        // A single rank starts alone.
        return (ranks > 1 && is_hydra && !is_open_mpi).then(|| Foreign {
            found: format!(
                "PMI_SIZE says that the mpiexec of MPICH or Intel MPI started this program as {}",
                as_one(ranks)
            ),
            needs: Needs::OpenMpi,
            otherwise: "",
            rank,
        });
    }
    let is_of_mpich = ["MPICH", "MVAPICH", "Intel(R) MPI"]
        .iter()
        .any(|name| library.contains(name));
    let speaks_pmix = library.to_lowercase().contains("pmix") || is_set("I_MPI_PMI_LIBRARY");
    if !is_of_mpich || speaks_pmix || from_hydra.is_some() {
        return None;
    }
    let started = number("OMPI_COMM_WORLD_RANK").zip(number("OMPI_COMM_WORLD_SIZE"));
    if let Some((rank, ranks)) = started {
        // Older ones then start as a single rank.
        return (ranks > 1 || ends_at_pmix(library)).then(|| Foreign {
            found: format!(
                "OMPI_COMM_WORLD_SIZE says that Open MPI's mpirun started this program as {}",
                as_one(ranks)
            ),
            needs: Needs::Mpich,
            otherwise: if ranks == 1 {
                ", or without a launcher"
            } else {
                ""
            },
            rank,
        });
    }
    let rank = number("PMIX_RANK")?;
    ends_at_pmix(library).then(|| Foreign {
        found: "PMIX_RANK says that a launcher with PMIx, such as srun --mpi=pmix, started this program".into(),
        needs: Needs::Mpich,
        otherwise: ", or srun --mpi=pmi2",
        rank,
    })
}

/// Whether a library, which is MPICH without PMIx, ends the process where a launcher offers PMIx
/// alone: since MPICH 5.
fn ends_at_pmix(library: &str) -> bool {
    let version = library.strip_prefix("MPICH Version:");
    let major = version.and_then(|rest| rest.trim_start().split('.').next());
    major.and_then(|major| major.parse::<u32>().ok()) >= Some(5)
}

#[cfg(test)]
mod tests {
    use super::{Foreign, Needs, foreign, launched};

    #[test]
    fn ranks_of_another_mpi_are_told_from_other_processes() {
        let found = |environment: &[(&str, &str)]| {
            let of = |name: &str| environment.iter().find(|(known, _)| *known == name);
            launched(|name| of(name).map(|(_, value)| (*value).to_string()), 7)
        };
        for (environment, ranks) in [
            (&[][..], None),
            (&[("OMPI_COMM_WORLD_SIZE", "2")], Some(2)),
            (&[("PMI_SIZE", "3"), ("PMI_RANK", "0")], Some(3)),
            (&[("PMI_SIZE", "1"), ("PMI_RANK", "0")], None),
            (&[("PMIX_RANK", "0")], None),
            (&[("PMIX_RANK", "3")], Some(4)),
            // A task of srun.
            (
                &[("SLURM_STEP_NUM_TASKS", "4"), ("SLURM_TASK_PID", "7")],
                Some(4),
            ),
            (
                &[("SLURM_STEP_NUM_TASKS", "1"), ("SLURM_TASK_PID", "7")],
                None,
            ),
            // A program of a batch script for four tasks, or of a shell under srun.
            (
                &[
                    ("SLURM_NTASKS", "4"),
                    ("SLURM_PROCID", "0"),
                    ("SLURM_TASK_PID", "7"),
                ],
                None,
            ),
            (
                &[("SLURM_STEP_NUM_TASKS", "4"), ("SLURM_TASK_PID", "6")],
                None,
            ),
        ] {
            assert_eq!(
                found(environment).map(|found| found.1),
                ranks,
                "{environment:?}"
            );
        }
    }

    const OPEN_MPI: &str = "Open MPI v4.1.4, package: Debian OpenMPI, ident: 4.1.4";
    const MPICH_4: &str = "MPICH Version:\t4.0.2\nMPICH configure:\t--with-device=ch4:ofi";
    const MPICH_5: &str = "MPICH Version:      5.0.2\nMPICH configure:    --with-pm=hydra:gforker";
    const WITH_PMIX: &str = "MPICH Version:      5.0.2\nMPICH configure:    --with-pmix=/usr";
    const INTEL: &str = "Intel(R) MPI Library 2021.19 for Linux* OS";

    /// The launcher that this library needs, and the rank, if these variables are of one that it
    /// does not understand.
    fn needed(library: &str, environment: &str) -> Option<(Needs, u64)> {
        let variables: Vec<_> = environment
            .split_whitespace()
            .filter_map(|variable| variable.split_once('='))
            .collect();
        let found = foreign(library, |name| {
            let known = variables.iter().find(|(known, _)| *known == name);
            known.map(|(_, value)| (*value).to_string())
        });
        found.map(|Foreign { needs, rank, .. }| (needs, rank))
    }

    #[test]
    fn a_launcher_of_another_mpi_is_found_before_mpi_starts() {
        let mpirun = "OMPI_COMM_WORLD_SIZE=4 OMPI_COMM_WORLD_RANK=2 PMIX_RANK=2 PMIX_NAMESPACE=1";
        for library in [MPICH_4, MPICH_5, INTEL] {
            assert_eq!(
                needed(library, mpirun),
                Some((Needs::Mpich, 2)),
                "{library}"
            );
            // Under its own mpiexec, started by a rank of Open MPI.
            let within = format!("{mpirun} PMI_RANK=0 PMI_SIZE=2 HYDI_CONTROL_FD=7");
            assert_eq!(needed(library, &within), None);
        }
        for (library, within) in [
            (OPEN_MPI, mpirun),
            (WITH_PMIX, mpirun),
            (
                INTEL,
                &format!("{mpirun} I_MPI_PMI_LIBRARY=/usr/lib/libpmix.so"),
            ),
            ("another MPI 1.0", mpirun),
        ] {
            assert_eq!(needed(library, within), None, "{library} {within}");
        }
        // One rank: MPICH 5 ends in its start.
        let one = "OMPI_COMM_WORLD_SIZE=1 OMPI_COMM_WORLD_RANK=0 PMIX_RANK=0 PMIX_NAMESPACE=1";
        assert_eq!(needed(MPICH_4, one), None);
        assert_eq!(needed(MPICH_5, one), Some((Needs::Mpich, 0)));

        let hydra = "PMI_RANK=1 PMI_SIZE=3 PMI_FD=9 HYDI_CONTROL_FD=7";
        assert_eq!(needed(OPEN_MPI, hydra), Some((Needs::OpenMpi, 1)));
        assert_eq!(
            needed(OPEN_MPI, "PMI_RANK=1 PMI_SIZE=3"),
            Some((Needs::OpenMpi, 1))
        );
        assert_eq!(
            needed(OPEN_MPI, "PMI_RANK=0 PMI_SIZE=1 HYDI_CONTROL_FD=7"),
            None
        );
        // Started by mpirun within hydra.
        assert_eq!(needed(OPEN_MPI, &format!("{hydra} {mpirun}")), None);
        // hydra within a job of Slurm.
        let within = format!("{hydra} SLURM_PROCID=0");
        assert_eq!(needed(OPEN_MPI, &within), Some((Needs::OpenMpi, 1)));
        for library in [MPICH_4, MPICH_5, WITH_PMIX, INTEL] {
            assert_eq!(needed(library, hydra), None, "{library}");
        }
    }

    /// Batch systems start any MPI; only where MPICH would end at once it is told before.
    #[test]
    fn launchers_of_batch_systems_are_left_alone() {
        let pmi2 = "SLURM_PROCID=1 SLURM_STEP_NUM_TASKS=4 PMI_RANK=1 PMI_SIZE=4 PMI_FD=6";
        let pmix = "SLURM_PROCID=1 SLURM_STEP_NUM_TASKS=4 PMIX_RANK=1 PMIX_NAMESPACE=slurm.pmix";
        let flux = "FLUX_TASK_RANK=1 PMI_RANK=1 PMI_SIZE=4 PMI_FD=20";
        let flux_pmix = "FLUX_TASK_RANK=1 PMIX_RANK=1 PMIX_NAMESPACE=f";
        let pals = "PALS_RANKID=1 PMI_RANK=1 PMI_SIZE=4";
        for library in [OPEN_MPI, MPICH_4, MPICH_5, WITH_PMIX, INTEL] {
            for environment in ["", pmi2, flux, pals, "PBS_JOBID=1", "LSB_JOBID=1"] {
                assert_eq!(
                    needed(library, environment),
                    None,
                    "{library} {environment}"
                );
            }
            let ends = library == MPICH_5;
            for environment in [pmix, flux_pmix] {
                let expected = ends.then_some((Needs::Mpich, 1));
                assert_eq!(needed(library, environment), expected, "{library}");
            }
        }
    }
}
