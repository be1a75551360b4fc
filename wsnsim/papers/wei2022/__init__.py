"""Wei, Guo (2022): PF, CS-PF and ICS-PF."""
