"""Behaviour-tree policies (BehaviorTree.CPP) that tick skills over a transport."""
