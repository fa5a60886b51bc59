class Bool:
    NAME = "std_msgs/msg/Bool"

    @staticmethod
    def get_fields_and_field_types():
        return {"data": "boolean"}


class Odd:
    NAME = "std_msgs/msg/Odd"

    @staticmethod
    def get_fields_and_field_types():
        return {"flag": "boolean", "values": "sequence<std_msgs/Bool, 3>"}
