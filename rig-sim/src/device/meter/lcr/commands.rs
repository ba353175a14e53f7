//! What the family is told: its command tree, and the settings that are merely kept.

use rig_scpi::{Limits, Node, Tree, Unit, command, query, setting};

use super::super::{
    Quantity,
    kept::{self, Kept, action, number, switch, text, whole, word},
};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Command {
    Abort,
    Alc,
    Aperture,
    BiasCurrent,
    BiasState,
    BiasVolt,
    ByteOrder,
    Comparator,
    Continuous,
    Current,
    Fetch,
    FetchImpedance,
    FetchMonitor(Monitor),
    Format,
    Frequency,
    Function,
    HighPower,
    Init,
    /// A row of [`KEPT`].
    Kept(usize),
    List,
    ListClear,
    ListMode,
    LongDigits,
    Monitor(Monitor),
    /// A row of the settings that only one make has.
    Own(usize),
    Options,
    Page,
    Range,
    RangeAuto,
    Reset,
    Source,
    StepDelay,
    Trigger,
    TriggerAndRead,
    TriggerDelay,
    Volt,
}

/// What is measured at the terminals beside the impedance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Monitor {
    Vac,
    Iac,
    Vdc,
    Idc,
}

pub(super) const COMMANDS: &[Node<Command>] = &[
    query("*OPT", Command::Options),
    command("*RST", Command::Reset),
    command("*TRG", Command::TriggerAndRead),
    command(":ABORt", Command::Abort),
    setting(":AMPLitude:ALC", Command::Alc).asks(0, 0),
    setting(":APERture", Command::Aperture).takes(1, 2).asks(0, 0),
    setting(":BIAS:CURRent[:LEVel]", Command::BiasCurrent),
    setting(":BIAS:STATe", Command::BiasState).asks(0, 0),
    setting(":BIAS:VOLTage[:LEVel]", Command::BiasVolt),
    setting(":COMParator[:STATe]", Command::Comparator).asks(0, 0),
    setting(":CURRent[:LEVel]", Command::Current),
    setting(":DISPlay:PAGE", Command::Page).asks(0, 0),
    query(":FETCh[:IMPedance][:FORMatted]", Command::Fetch),
    query(":FETCh[:IMPedance]:CORRected", Command::FetchImpedance),
    query(":FETCh:SMONitor:IAC", Command::FetchMonitor(Monitor::Iac)),
    query(":FETCh:SMONitor:IDC", Command::FetchMonitor(Monitor::Idc)),
    query(":FETCh:SMONitor:VAC", Command::FetchMonitor(Monitor::Vac)),
    query(":FETCh:SMONitor:VDC", Command::FetchMonitor(Monitor::Vdc)),
    setting(":FORMat[:DATA]", Command::Format).takes(1, 2).asks(0, 0),
    setting(":FORMat:ASCii:LONG", Command::LongDigits).asks(0, 0),
    setting(":FORMat:BORDer", Command::ByteOrder).asks(0, 0),
    setting(":FREQuency[:CW]", Command::Frequency),
    setting(":FUNCtion:IMPedance[:TYPE]", Command::Function).asks(0, 0),
    setting(":FUNCtion:IMPedance:RANGe[:VALue]", Command::Range),
    setting(":FUNCtion:IMPedance:RANGe:AUTO", Command::RangeAuto).asks(0, 0),
    setting(":FUNCtion:SMONitor:IAC[:STATe]", Command::Monitor(Monitor::Iac)).asks(0, 0),
    setting(":FUNCtion:SMONitor:IDC[:STATe]", Command::Monitor(Monitor::Idc)).asks(0, 0),
    setting(":FUNCtion:SMONitor:VAC[:STATe]", Command::Monitor(Monitor::Vac)).asks(0, 0),
    setting(":FUNCtion:SMONitor:VDC[:STATe]", Command::Monitor(Monitor::Vdc)).asks(0, 0),
    setting(":OUTPut:HPOWer", Command::HighPower).asks(0, 0),
    command(":INITiate[:IMMediate]", Command::Init),
    setting(":INITiate:CONTinuous", Command::Continuous).asks(0, 0),
    command(":LIST:CLEar:ALL", Command::ListClear),
    setting(":LIST:FREQuency", Command::List).takes(1, MAX_LIST).asks(0, 0),
    setting(":LIST:MODE", Command::ListMode).asks(0, 0),
    command(":SYSTem:PRESet", Command::Reset),
    command(":TRIGger[:IMMediate]", Command::Trigger),
    setting(":TRIGger:DELay", Command::StepDelay),
    setting(":TRIGger:SOURce", Command::Source).asks(0, 0),
    setting(":TRIGger:TDELay", Command::TriggerDelay),
    setting(":VOLTage[:LEVel]", Command::Volt),
];

/// The longest list.
const MAX_LIST: usize = 201;

const ANY: Limits = Limits { min: -9.9e37, max: 9.9e37, default: 0.0 };

const SPOT: Limits = Limits { min: 20.0, max: 2e6, default: 1e3 };

const DEVIATION: &[&str] = &["OFF"];

const LOAD: &[&str] = &[
    "CPD", "CPQ", "CPG", "CPRP", "CSD", "CSQ", "CSRS", "LPD", "LPQ", "LPG", "LPRP", "LSD", "LSQ",
    "LSRS", "RX", "ZTD", "ZTR", "GB", "YTD", "YTR",
];

/// What all makes keep. There is nothing to correct at ideal terminals, so that every correction is
/// one of nothing. A deviation from a reference would change what is read, and stays off.
///
/// # Source
/// Commands that public drivers send to the E4980A and the 4284A when they connect, or in their
/// getters: `QCoDeS`, `PyMeasure`, `SweepMe!`, `gotmc/ivi`, and scripts of laboratories.
pub(super) const KEPT: &[Kept] = &[
    switch(":COMParator:ABIN", false),
    action(":COMParator:BIN:CLEar"),
    switch(":COMParator:BIN:COUNt[:STATe]", false),
    action(":COMParator:BIN:COUNt:CLEar"),
    word(":COMParator:MODE", &["PTOLerance", "ATOLerance", "SEQuence"]),
    switch(":COMParator:SWAP", false),
    number(":COMParator:TOLerance:NOMinal", Unit::NONE, ANY),
    whole(":CORRection:LENGth", Unit::new("M"), &[0, 1, 2, 4]),
    switch(":CORRection:LOAD:STATe", false),
    word(":CORRection:LOAD:TYPE", LOAD),
    word(":CORRection:METHod", &["SINGle", "MULTi"]),
    action(":CORRection:OPEN[:EXECute]"),
    switch(":CORRection:OPEN:STATe", false),
    action(":CORRection:SHORt[:EXECute]"),
    switch(":CORRection:SHORt:STATe", false),
    number(":CORRection:SPOT#(1:201):FREQuency", Unit::HERTZ, SPOT),
    action(":CORRection:SPOT#(1:201):LOAD"),
    action(":CORRection:SPOT#(1:201):OPEN"),
    action(":CORRection:SPOT#(1:201):SHORt"),
    switch(":CORRection:SPOT#(1:201):STATe", false),
    action(":DISPlay:CCLear"),
    switch(":DISPlay:ENABle", true),
    text(":DISPlay:LINE"),
    word(":FUNCtion:DEV#(1:2):MODE", DEVIATION),
    number(":FUNCtion:DEV#(1:2):REFerence[:VALue]", Unit::NONE, ANY),
    switch(":OUTPut:DC:ISOLation[:STATe]", false),
    action(":SYSTem:BEEPer[:IMMediate]"),
    switch(":SYSTem:BEEPer:STATe", true),
    switch(":SYSTem:KLOCk", false),
];

/// What only the E4980A keeps.
pub(super) const E4980A_KEPT: &[Kept] = &[
    switch(":BIAS:POLarity:AUTO", false),
    switch(":BIAS:RANGe:AUTO", true),
    switch(":FUNCtion:DCResistance:RANGe:AUTO", true),
    number(":FUNCtion:DCResistance:RANGe[:VALue]", Unit::OHM, ANY),
    switch(":OUTPut:DC:ISOLation:LEVel:AUTO", true),
    number(":OUTPut:DC:ISOLation:LEVel[:VALue]", Unit::AMPERE, ANY),
    switch(":SOURce:DCSource:STATe", false),
    number(":SOURce:DCSource:VOLTage[:LEVel]", Unit::VOLT, ANY),
    whole(":SYSTem:BEEPer:TONE", Unit::NONE, &[3, 1, 2, 4, 5]),
];

/// What only the TH2832 keeps: the resistance of its source, ohm.
pub(super) const TH2832_KEPT: &[Kept] = &[whole(":ORESister", Unit::OHM, &[100, 30, 50])];

/// The commands of a make that keeps these settings besides those of the family.
pub(super) fn tree(own: &[Kept]) -> Tree<Command> {
    let rows = kept::nodes(KEPT, Command::Kept).chain(kept::nodes(own, Command::Own));
    let nodes: Vec<Node<Command>> = COMMANDS.iter().copied().chain(rows).collect();
    Tree::new(&nodes).expect("the commands are constants, and a test builds them")
}

/// The pairs of values that can be asked for.
pub(super) const FUNCTIONS: &[(&str, (Quantity, Quantity))] = &[
    ("CPD", (Quantity::Cp, Quantity::D)),
    ("CPQ", (Quantity::Cp, Quantity::Q)),
    ("CPG", (Quantity::Cp, Quantity::G)),
    ("CPRP", (Quantity::Cp, Quantity::Rp)),
    ("CSD", (Quantity::Cs, Quantity::D)),
    ("CSQ", (Quantity::Cs, Quantity::Q)),
    ("CSRS", (Quantity::Cs, Quantity::Rs)),
    ("LPD", (Quantity::Lp, Quantity::D)),
    ("LPQ", (Quantity::Lp, Quantity::Q)),
    ("LPG", (Quantity::Lp, Quantity::G)),
    ("LPRP", (Quantity::Lp, Quantity::Rp)),
    ("LSD", (Quantity::Ls, Quantity::D)),
    ("LSQ", (Quantity::Ls, Quantity::Q)),
    ("LSRS", (Quantity::Ls, Quantity::Rs)),
    ("RX", (Quantity::Rs, Quantity::X)),
    ("ZTD", (Quantity::Z, Quantity::PhaseDeg)),
    ("ZTR", (Quantity::Z, Quantity::PhaseRad)),
    ("GB", (Quantity::G, Quantity::B)),
    ("YTD", (Quantity::Y, Quantity::AdmittancePhaseDeg)),
    ("YTR", (Quantity::Y, Quantity::AdmittancePhaseRad)),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    Internal,
    Hold,
    External,
    Bus,
}

pub(super) const SOURCES: &[(&str, Source)] = &[
    ("INTernal", Source::Internal),
    ("HOLD", Source::Hold),
    ("EXTernal", Source::External),
    ("BUS", Source::Bus),
];

pub(super) const APERTURES: [(&str, usize); 3] = [("SHORt", 0), ("MEDium", 1), ("LONG", 2)];

/// The pages of the display; only one of them measures a list.
pub(super) const PAGES: &[(&str, &str)] = &[
    ("MEASurement", "MEAS"),
    ("LIST", "LIST"),
    ("BNUMber", "BNUM"),
    ("BCOunt", "BCO"),
    ("MSETup", "MSET"),
    ("CSETup", "CSET"),
    ("LTABle", "LTAB"),
    ("LSETup", "LSET"),
    ("CATalog", "CAT"),
    ("SYSTem", "SYST"),
    ("SELF", "SELF"),
];
