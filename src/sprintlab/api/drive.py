"""Drive and air in which a policy is measured: motor model, battery, heat, outdoors or treadmill."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from sprintlab.core.arguments import check_fields
from sprintlab.core.checks import check_choice

if TYPE_CHECKING:
    from sprintlab.plant import PlantOptions


@dataclass(frozen=True, kw_only=True)
class DriveOptions:
    """Drive and air in which the policy is measured; published numbers use the defaults.

    Attributes:
        air: outdoors (drag of still air on the trunk) or treadmill (no drag).
        motor_model: refined, simplified-dc, square or flux-weakening.
        battery: supply the joints from the robot's battery, whose voltage sags under load.
        heat: let copper loss warm the windings.
        supply: TOML file with tables [battery], [heat] or [i2t]; each table that it has is simulated.
        state_of_charge: state of charge of the battery at the start, 0 to 1.
        winding_temperature: temperature of the windings at the start [degC].
    """

    air: Literal["outdoors", "treadmill"] = "outdoors"
    motor_model: str = "refined"
    battery: bool = False
    heat: bool = False
    supply: Path | None = None
    state_of_charge: float = 1.0
    winding_temperature: float = 25.0

    def plant(self, **more: Any) -> PlantOptions:
        """How the robot is simulated; ``more`` are further fields of ``PlantOptions``."""
        from sprintlab.motors import SupplyFile, WindingHeat, load_supply
        from sprintlab.plant import PlantOptions

        check_fields(self)
        check_choice("air", self.air, ("outdoors", "treadmill"))
        supply = load_supply(self.supply) if self.supply else SupplyFile(battery=None, heat=None, i2t=None)
        return PlantOptions(
            drag_area=None if self.air == "outdoors" else 0.0,
            motor_model=cast("Any", self.motor_model),
            battery=supply.battery or ("robot" if self.battery else None),
            heat=supply.heat or (WindingHeat() if self.heat else None),
            state_of_charge=self.state_of_charge,
            winding_temperature=self.winding_temperature,
            i2t=supply.i2t,
            **more,
        )
