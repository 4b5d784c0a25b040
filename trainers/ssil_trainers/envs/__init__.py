"""Driving environments, registered with gymnasium; a simulator is imported when one is made."""

import gymnasium

gymnasium.register(
    id="SSILRacetrack-v0",
    entry_point="ssil_trainers.envs.racetrack.env:RacetrackEnv",
    vector_entry_point="ssil_trainers.envs.racetrack.vector_env:RacetrackVectorEnv",
)
gymnasium.register(
    id="RCLidar-v0",
    entry_point="ssil_trainers.envs.rc_lidar.env:RCLidarEnv",
    vector_entry_point="ssil_trainers.envs.rc_lidar.vector_env:RCLidarVectorEnv",
)
