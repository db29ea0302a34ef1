"""draft"""
from __future__ import annotations
import numpy as np
from pzt_ros.physics import front_kernel as kernel
from pzt_ros.physics.front_kinetics import profile_table
from pzt_ros.physics.front_tables import everett
from pzt_ros.physics.density import Gaussian
