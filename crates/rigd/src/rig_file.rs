//! The rig file: which device is on which port, and what the bench can do.
