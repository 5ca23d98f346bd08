"""Names that other sub-rooms import, and where each lives."""

from .baseline import baseline_levels as baseline_levels
from .channels import AlarmMessage as AlarmMessage
from .channels import ChannelError as ChannelError
from .channels import send as send
from .monitor import PointJudgment as PointJudgment
from .monitor import PointMonitor as PointMonitor
from .monitor import PointState as PointState
from .points import OperatingPoint as OperatingPoint
from .points import choose_point as choose_point
from .sensors import SensorFinding as SensorFinding
from .testing import Change as Change
from .testing import Condition as Condition
from .testing import ConformalTest as ConformalTest
