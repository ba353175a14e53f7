//! The command tree of the family, and its stored settings.

use rig_scpi::{Limits, Node, Tree, Unit, command, query, setting};

use super::super::{
    Quantity,
    setting_store::{self, StoredSetting, action, number, switch, text, whole, word},
};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LcrCommand {
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
    StoredSetting(usize),
    List,
    ListClear,
    ListMode,
    LongDigits,
    Monitor(Monitor),
    /// A row of the settings that only one make has.
    Own(usize),
    Options,
    Page,
    Preset,
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

/// The quantities at the terminals beside the impedance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Monitor {
    Vac,
    Iac,
    Vdc,
    Idc,
}

pub(super) const COMMANDS: &[Node<LcrCommand>] = &[
    query("*OPT", LcrCommand::Options),
    command("*RST", LcrCommand::Reset),
    command("*TRG", LcrCommand::TriggerAndRead),
    command(":ABORt", LcrCommand::Abort),
    setting(":AMPLitude:ALC", LcrCommand::Alc).asks(0, 0),
    setting(":APERture", LcrCommand::Aperture).takes(1, 2).asks(0, 0),
    setting(":BIAS:CURRent[:LEVel]", LcrCommand::BiasCurrent),
    setting(":BIAS:STATe", LcrCommand::BiasState).asks(0, 0),
    setting(":BIAS:VOLTage[:LEVel]", LcrCommand::BiasVolt),
    setting(":COMParator[:STATe]", LcrCommand::Comparator).asks(0, 0),
    setting(":CURRent[:LEVel]", LcrCommand::Current),
    setting(":DISPlay:PAGE", LcrCommand::Page).asks(0, 0),
    query(":FETCh[:IMPedance][:FORMatted]", LcrCommand::Fetch),
    query(":FETCh[:IMPedance]:CORRected", LcrCommand::FetchImpedance),
    query(":FETCh:SMONitor:IAC", LcrCommand::FetchMonitor(Monitor::Iac)),
    query(":FETCh:SMONitor:IDC", LcrCommand::FetchMonitor(Monitor::Idc)),
    query(":FETCh:SMONitor:VAC", LcrCommand::FetchMonitor(Monitor::Vac)),
    query(":FETCh:SMONitor:VDC", LcrCommand::FetchMonitor(Monitor::Vdc)),
    setting(":FORMat[:DATA]", LcrCommand::Format).takes(1, 2).asks(0, 0),
    setting(":FORMat:ASCii:LONG", LcrCommand::LongDigits).asks(0, 0),
    setting(":FORMat:BORDer", LcrCommand::ByteOrder).asks(0, 0),
    setting(":FREQuency[:CW]", LcrCommand::Frequency),
    setting(":FUNCtion:IMPedance[:TYPE]", LcrCommand::Function).asks(0, 0),
    setting(":FUNCtion:IMPedance:RANGe[:VALue]", LcrCommand::Range),
    setting(":FUNCtion:IMPedance:RANGe:AUTO", LcrCommand::RangeAuto).asks(0, 0),
    setting(":FUNCtion:SMONitor:IAC[:STATe]", LcrCommand::Monitor(Monitor::Iac)).asks(0, 0),
    setting(":FUNCtion:SMONitor:IDC[:STATe]", LcrCommand::Monitor(Monitor::Idc)).asks(0, 0),
    setting(":FUNCtion:SMONitor:VAC[:STATe]", LcrCommand::Monitor(Monitor::Vac)).asks(0, 0),
    setting(":FUNCtion:SMONitor:VDC[:STATe]", LcrCommand::Monitor(Monitor::Vdc)).asks(0, 0),
    setting(":OUTPut:HPOWer", LcrCommand::HighPower).asks(0, 0),
    command(":INITiate[:IMMediate]", LcrCommand::Init),
    setting(":INITiate:CONTinuous", LcrCommand::Continuous).asks(0, 0),
    command(":LIST:CLEar:ALL", LcrCommand::ListClear),
    setting(":LIST:FREQuency", LcrCommand::List).takes(1, MAX_LIST).asks(0, 0),
    setting(":LIST:MODE", LcrCommand::ListMode).asks(0, 0),
    command(":SYSTem:PRESet", LcrCommand::Preset),
    command(":TRIGger[:IMMediate]", LcrCommand::Trigger),
    setting(":TRIGger:DELay", LcrCommand::StepDelay),
    setting(":TRIGger:SOURce", LcrCommand::Source).asks(0, 0),
    setting(":TRIGger:TDELay", LcrCommand::TriggerDelay),
    setting(":VOLTage[:LEVel]", LcrCommand::Volt),
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

/// Stored settings of all makes. Ideal terminals need no correction, so that every correction has
/// no effect. A deviation from a reference would change the readings, and stays off.
///
/// # Source
/// Commands that public drivers send to the E4980A and the 4284A when they connect, or in their
/// getters: `QCoDeS`, `PyMeasure`, `SweepMe!`, `gotmc/ivi`, and scripts of laboratories.
pub(super) const KEPT: &[StoredSetting] = &[
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

/// The stored settings of the E4980A only.
pub(super) const E4980A_KEPT: &[StoredSetting] = &[
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

/// The stored setting of the TH2832 only: the resistance of its source, ohm.
pub(super) const TH2832_KEPT: &[StoredSetting] = &[whole(":ORESister", Unit::OHM, &[100, 30, 50])];

/// The commands of a make that stores these settings in addition to those of the family.
pub(super) fn tree(own: &[StoredSetting]) -> Tree<LcrCommand> {
    let rows = setting_store::nodes(KEPT, LcrCommand::StoredSetting)
        .chain(setting_store::nodes(own, LcrCommand::Own));
    let nodes: Vec<Node<LcrCommand>> = COMMANDS.iter().copied().chain(rows).collect();
    Tree::new(&nodes).expect("the commands are constants, and a test builds them")
}

/// The pairs of values that can be requested.
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
