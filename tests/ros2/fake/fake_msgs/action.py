from types import SimpleNamespace


def _request():
    return SimpleNamespace(
        goal_id=SimpleNamespace(uuid=[]),
        goal_info=SimpleNamespace(goal_id=SimpleNamespace(uuid=[])),
        goal=None,
    )


class _Service:
    Request = staticmethod(_request)


class Walk:
    Goal = "Walk_Goal"
    Impl = SimpleNamespace(
        SendGoalService=_Service,
        CancelGoalService=_Service,
        FeedbackMessage=object,
        GoalStatusMessage=object,
    )
