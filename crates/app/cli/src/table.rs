//! Tables of commands.

use weaver_command::{Console, Failure, Interrupt};

/// Makes the commands of a table: the enum that clap parses into, the groups of the help, and the call. Commands of
/// another table may follow (`and`).
macro_rules! table {
    (
        $table:ident:
        $($title:literal: { $($(#[cfg($when:meta)])? $name:ident($arguments:ty) => $run:expr,)+ })+
        $(and $others:ident)?
    ) => {
        /// One command.
        #[derive(Debug, Subcommand)]
        pub enum $table {
            $($($(#[cfg($when)])? $name($arguments),)+)+
            $(#[command(flatten)] $others($others),)?
        }

        impl $table {
            /// Titles of the groups in the help, and how many commands are in each, in the commands' order.
            pub const GROUPS: &[(&str, usize)] = &[$(($title, 0 $(+ table!(@one $($when)?))+)),+];

            /// Runs the command.
            // A program without methods has a table without rows.
            #[allow(unused_variables)]
            pub fn run(&self, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
                match *self {
                    $($($(#[cfg($when)])? Self::$name(ref arguments) => $crate::table::call($run, arguments, console, interrupt),)+)+
                    $(Self::$others(ref others) => others.run(console, interrupt),)?
                }
            }
        }
    };
    (@one) => { 1 };
    (@one $when:meta) => { cfg!($when) as usize };
}

/// Calls the function of a row; this signature lets its argument types be inferred.
pub fn call<A>(
    run: impl FnOnce(&A, &mut Console, &Interrupt) -> Result<(), Failure>,
    arguments: &A,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    run(arguments, console, interrupt)
}

pub(crate) use table;
