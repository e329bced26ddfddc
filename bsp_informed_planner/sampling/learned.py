"""The guide of the sampler id "learned": by the kind of the model that there is for the robot."""

from __future__ import annotations

from bsp_informed_planner.sampling.guide import Guide, GuideSetting
from bsp_informed_planner.sampling.models import KEYPOINT_KINDS, find_card, read_once
from bsp_informed_planner.sampling.path_proposals import KIND as PATH_CHAINS


def learned_guide(setting: GuideSetting) -> Guide:
    """Keypoints one after the other for planar robots; whole chains for arms, without torch.

    Raises:
        ModelUnavailableError: if there is no model of keypoints for the robot.
        ModelError: if a model is damaged.
        ModelMismatchError: if a model is of another version.
    """
    path, card = find_card(setting.robot, (PATH_CHAINS, *KEYPOINT_KINDS), setting.models)
    if card.kind == PATH_CHAINS:
        from bsp_informed_planner.sampling.path_chain_guide import PathChainGuide
        from bsp_informed_planner.sampling.path_proposals import PathProposals

        return PathChainGuide(setting, read_once(PathProposals.load, path))
    from bsp_informed_planner.sampling.learned_guide import keypoint_guide

    return keypoint_guide(setting)
