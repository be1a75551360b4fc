"""Ruan, Wang, Yang, Zhang (2020): PF, GPF, PSO-GPF and GSA-GPF."""
