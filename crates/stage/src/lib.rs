//! What each Modbus axis controller must be told; register maps are data.
