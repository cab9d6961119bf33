"""The demo of the connector cell: one goal, two arms, a latch whose click is felt."""
