"""The leaves of Nav2, so that one which is not bound is told with what binds it.

Source: ``nav2_tree_nodes.xml`` of the package ``nav2_behavior_tree``, of ROS 2 Jazzy and later.
"""

from __future__ import annotations

_ACTIONS = {
    "AssistedTeleop": "assisted_teleop",
    "BackUp": "backup",
    "ComputeAndTrackRoute": "compute_and_track_route",
    "ComputePathThroughPoses": "compute_path_through_poses",
    "ComputePathToPose": "compute_path_to_pose",
    "ComputeRoute": "compute_route",
    "DriveOnHeading": "drive_on_heading",
    "FollowPath": "follow_path",
    "NavigateThroughPoses": "navigate_through_poses",
    "NavigateToPose": "navigate_to_pose",
    "SmoothPath": "smooth_path",
    "Spin": "spin",
    "Wait": "wait",
}
"""Leaves that send a goal, whose type is named as the leaf is, and the name of the action."""
_SERVICES = {
    "ClearCostmapAroundPose": ("{service_name}", "nav2_msgs/srv/ClearCostmapAroundPose"),
    "ClearCostmapAroundRobot": ("{service_name}", "nav2_msgs/srv/ClearCostmapAroundRobot"),
    "ClearCostmapExceptRegion": ("{service_name}", "nav2_msgs/srv/ClearCostmapExceptRegion"),
    "ClearEntireCostmap": ("{service_name}", "nav2_msgs/srv/ClearEntireCostmap"),
    "IsPathValid": ("/is_path_valid", "nav2_msgs/srv/IsPathValid"),
    "ReinitializeGlobalLocalization": (
        "/reinitialize_global_localization",
        "std_srvs/srv/Empty",
    ),
}
_TOPICS = {
    "IsBatteryCharging": ("{battery_topic}", "_msg.power_supply_status == 1"),
    "IsBatteryLow": ("{battery_topic}", "_msg.percentage &lt;= min_battery"),
}
"""Leaves that look at the last ``sensor_msgs/msg/BatteryState``: its topic, and when they succeed."""
_OF_ITS_NODE = frozenset(
    {
        *("AreErrorCodesPresent", "ArePosesNear", "CancelAssistedTeleop", "CancelBackUp"),
        *("CancelComputeAndTrackRoute", "CancelControl", "CancelDriveOnHeading", "CancelSpin"),
        *("CancelWait", "ConcatenatePaths", "ControllerSelector", "DistanceController"),
        *("DistanceTraveled", "GetCurrentPose", "GetPoseFromPath", "GlobalUpdatedGoal"),
        *("GoalCheckerSelector", "GoalReached", "GoalUpdated", "GoalUpdatedController"),
        *("GoalUpdater", "InitialPoseReceived", "IsStopped", "IsStuck", "PathExpiringTimer"),
        *("PathLongerOnApproach", "PauseResumeController", "PlannerSelector"),
        *("ProgressCheckerSelector", "RemoveInCollisionGoals", "RemovePassedGoals"),
        *("SmootherSelector", "SpeedController", "TimeExpired", "TransformAvailable"),
        *("TruncatePath", "TruncatePathLocal", "WouldAControllerRecoveryHelp"),
        *("WouldAPlannerRecoveryHelp", "WouldARouteRecoveryHelp", "WouldASmootherRecoveryHelp"),
    }
)
"""What Nav2 computes in the node that runs the tree: from transforms, its blackboard, or a clock."""


def nav2_hint(node: str) -> str:
    """What makes ``node`` known if Nav2 has a node of this name; "" if it has none."""
    if node in _ACTIONS:
        binding = f'action="/{_ACTIONS[node]}" type="nav2_msgs/action/{node}"'
    elif node in _SERVICES:
        channel, interface = _SERVICES[node]
        binding = f'service="{channel}" type="{interface}"'
    elif node in _TOPICS:
        channel, condition = _TOPICS[node]
        binding = f'topic="{channel}" type="sensor_msgs/msg/BatteryState" cond="{condition}"'
    elif node in _OF_ITS_NODE:
        return (
            "Nav2 computes it in the node that runs the tree; give the system a plugin of this name"
        )
    else:
        return ""
    leaf = f'<leaf ID="{node}" {binding}>'
    return f"it is Nav2's: bind it in the system file, {leaf} with a <field> for each port"
